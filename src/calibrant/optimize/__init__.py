"""Floor 1: block-sparse nonlinear least squares on manifolds; knows no cameras."""
