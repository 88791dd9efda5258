"""Floor 6: results for people: terminal, HTML."""
