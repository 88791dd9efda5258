"""Compiled rows and rays of the camera models."""
