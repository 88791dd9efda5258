"""What all formats of cameras, rigs, scenes and transforms have in common, and their register."""
