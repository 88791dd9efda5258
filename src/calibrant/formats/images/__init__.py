"""What the bytes of a picture say before it is decoded: its size, whether it is whole, how it is turned."""
