"""Tasks about results that are there already."""
