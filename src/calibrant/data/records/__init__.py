"""Records of what was found, by what found it: kept under `details` in a result file."""
