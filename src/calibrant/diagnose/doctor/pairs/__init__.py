"""What is wrong with the pictures of two cameras that are fixed to each other: pairing, sides, mirrors, lenses."""
