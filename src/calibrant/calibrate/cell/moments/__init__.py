"""What cameras saw at one moment: numbered alike, of one board, and by cameras that stand still to each other."""
