"""Segments of a picture by their colour: ranges of hue, saturation and value, and the connected parts within them."""
