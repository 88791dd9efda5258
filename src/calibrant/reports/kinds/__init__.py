"""What each kind of result is called and what it says of itself: one file a kind, one line in `registry`."""
