"""Objects followed from picture to picture: a filter of constant velocity, gated, with sigma."""
