"""Commands that lead a robot by what a camera sees."""
