"""Closed-form starts, robust against wrong views."""
