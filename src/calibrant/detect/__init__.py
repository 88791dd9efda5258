"""Floor 3: finding targets in images, one detector a target."""
