"""Clouds of many poses: do they agree, where the calibration puts them?"""
