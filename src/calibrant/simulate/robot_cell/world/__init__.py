"""The running physics."""
