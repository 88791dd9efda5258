"""A tool's tip, by touch or by sight."""
