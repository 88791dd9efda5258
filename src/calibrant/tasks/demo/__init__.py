"""The whole chain on a simulated cell, beside its truth."""
