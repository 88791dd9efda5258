"""Floor 8: experiments as functions that return tables."""
