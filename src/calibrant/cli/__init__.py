"""Floor 7: the command line, one file a command."""

from __future__ import annotations


def main() -> None:
    """Entry point of the `calibrant` command."""
    import gc
    import os

    # Matrices of tens of columns: BLAS's own threads wait for each other longer than they work (hand-eye of 1000 pose
    # pairs takes 1.7 times as long with two of them). Larger work is divided among threads and processes of ours.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Loading makes objects that stay: looking through all of them again and again is a tenth of a short command.
    gc.set_threshold(50_000, 20, 20)
    from calibrant.cli.application import run

    raise SystemExit(run())
