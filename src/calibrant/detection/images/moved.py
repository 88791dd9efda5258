"""Pictures that moved too far while they were exposed for the fit of their corners. Said, not left out."""

from __future__ import annotations

from collections.abc import Sequence

LISTED = 5


def notes_on_motion(pictures: Sequence[tuple[str, bool]]) -> tuple[str, ...]:
    """A sentence naming the pictures that moved too far; none for none. Args: a picture's name, and whether it did."""
    moved = [name for name, smeared in pictures if smeared]
    if not moved:
        return ()
    more = f" and {len(moved) - LISTED} more" if len(moved) > LISTED else ""
    return (
        f"{len(moved)} of {len(pictures)} pictures moved by half a square or more while they were exposed: "
        f"{', '.join(moved[:LISTED])}{more}. Their corners are less certain than stated: take them again at rest or "
        "with a shorter exposure, or leave them out.",
    )
