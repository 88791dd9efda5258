"""Coded markers and grids of them."""
