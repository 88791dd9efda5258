"""Points that a robot touches against where a camera said they are: errors, what was predicted, a correction."""
