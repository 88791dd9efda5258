"""Views that repeat each other: the same picture twice, and a board that has hardly moved. Said, not left out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.data import View

SAME_PX = 1e-6
"""Detection is deterministic: pictures whose points all agree to this are one picture."""
NEAR_PART = 0.002
"""Of the image's width: a board that moved less between two pictures shows the camera nothing new."""
LISTED = 5


def notes_on_likeness(views: Sequence[View], width: int) -> tuple[str, ...]:
    """Whole sentences naming the views that repeat another; none when all differ.

    A view is compared with those before it that show the same points.
    """
    same: list[str] = []
    near: list[str] = []
    earlier: dict[bytes, list[View]] = {}
    for view in views:
        before = earlier.setdefault(view.point_ids.tobytes(), [])
        distance = min((float(np.abs(view.uv - other.uv).max()) for other in before), default=np.inf)
        if distance <= SAME_PX:
            same.append(view.id)
        elif distance <= NEAR_PART * width:
            near.append(view.id)
        before.append(view)
    notes = []
    if same:
        notes.append(
            f"{len(same)} of {len(views)} pictures show exactly what another shows and count twice: {_listed(same)}. "
            "Leave the copies out."
        )
    if near:
        notes.append(
            f"In {len(near)} of {len(views)} pictures the board has moved less than {NEAR_PART * width:.1f} px since "
            f"another: {_listed(near)}. They lower the noise but show nothing new; take views that differ."
        )
    return tuple(notes)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:LISTED]) + (" …" if len(names) > LISTED else "")
