"""`python -m calibrant`: the command line, where the script is not on the path."""

from calibrant.cli import main

main()
