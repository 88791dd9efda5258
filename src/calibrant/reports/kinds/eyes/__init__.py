"""Kinds of what two eyes see: rectified pictures, depth, a pointing finger."""
