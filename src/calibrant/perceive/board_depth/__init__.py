"""Boards seen in colour and depth: their pose from both, and the depth's scale by them."""
