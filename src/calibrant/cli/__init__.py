"""Floor 7: the command line, one file a command."""

from __future__ import annotations


def main() -> None:
    """Entry point of the `calibrant` command."""
    import gc

    # Loading makes objects that stay: looking through all of them again and again is a tenth of a short command.
    gc.set_threshold(50_000, 20, 20)
    from calibrant.cli.application import run

    raise SystemExit(run())
