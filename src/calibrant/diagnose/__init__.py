"""Floor 6: what is wrong with the data, and how certain the result is."""
