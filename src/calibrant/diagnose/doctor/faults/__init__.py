"""One fault a file: `examine` asks a case for it and proposes the repair."""
