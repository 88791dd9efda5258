"""What a servo loop sees: features of pictures, free of the lens, and what the camera's motion does to them."""
