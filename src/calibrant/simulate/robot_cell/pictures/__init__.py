"""From the world to what a camera gives: renderers, lenses, boards, noise."""
