"""Floor 7: the command line, one file a command."""

from __future__ import annotations


def main() -> None:
    """Entry point of the `calibrant` command."""
    from calibrant.cli.application import run

    raise SystemExit(run())
