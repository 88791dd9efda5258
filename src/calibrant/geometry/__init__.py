"""Floor 0: rotations, rigid transforms, frames and projective geometry; NumPy and SciPy alone."""
