"""A cube set upon another one: seen by colour and depth, grasped, placed; with the reason where it fails."""
