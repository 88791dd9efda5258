"""Which pixel of a projector lights what a camera sees: captures of pattern sequences, decoded pixel by pixel."""
