"""Where a target is, from one view."""
