"""Tasks about cameras."""
