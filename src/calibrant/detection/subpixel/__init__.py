"""Where exactly a corner is, and how certain."""
