"""A project solved: observations found, problems set up as the commands do, and what is stale made anew."""
