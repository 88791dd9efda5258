"""Floor 7: experiments as functions that return tables."""
