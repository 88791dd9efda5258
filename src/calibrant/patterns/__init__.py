"""What a projector shows: Gray code, phase shifts and their order; no image processing."""
