"""Floor 0: how every file is read: through one door, with bounds, and with a word on what was not used."""
