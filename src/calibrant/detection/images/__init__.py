"""Photos, videos and live cameras, and what is kept of them."""
