"""Chessboards."""
