"""Tasks about robots and the cameras on them."""
