"""Projects: a cell's components, observations and results in a folder, edited and solved by commands."""
