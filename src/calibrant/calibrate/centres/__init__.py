"""Means and medians of transforms, compiled."""
