"""Tasks about projectors: what they show, how they are calibrated, what they measure."""
