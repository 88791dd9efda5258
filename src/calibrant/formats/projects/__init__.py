"""Projects: a folder with a `calibrant.yaml` that says what a cell is made of, who saw what, and what was found."""
