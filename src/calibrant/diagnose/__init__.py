"""Floor 5: what is wrong with the data, and how certain the result is."""
