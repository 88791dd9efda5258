"""What a cell is made of before a seed is drawn: devices, things, noise."""
