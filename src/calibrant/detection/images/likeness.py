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
    groups: dict[bytes, list[View]] = {}
    for view in views:
        groups.setdefault(view.point_ids.tobytes(), []).append(view)
    away = {
        v.id: d for group in groups.values() for v, d in zip(group, _to_earlier(group, NEAR_PART * width), strict=True)
    }
    same = [v.id for v in views if away[v.id] <= SAME_PX]
    near = [v.id for v in views if SAME_PX < away[v.id] <= NEAR_PART * width]
    notes = []
    if same:
        notes.append(
            f"{len(same)} of {len(views)} pictures show exactly what another shows and count twice: "
            f"{_listed_images(same)}. Leave the copies out."
        )
    if near:
        notes.append(
            f"In {len(near)} of {len(views)} pictures the board has moved less than {NEAR_PART * width:.1f} px since "
            f"another: {_listed_images(near)}. They lower the noise but show nothing new; take views that differ."
        )
    return tuple(notes)


def _to_earlier(views: Sequence[View], reach_px: float) -> list[float]:
    """Each view's largest distance of a point, px, from the likest view before it; infinite beyond `reach_px`."""
    if len(views[0]) == 0:
        return [np.inf] * len(views)
    # Two points tell nearly all views apart; only what they leave is compared in full.
    ends = np.array([np.concatenate([view.uv[0], view.uv[-1]]) for view in views])
    order = np.argsort(ends[:, 0])
    first = np.searchsorted(ends[order, 0], ends[:, 0] - reach_px, side="left")
    after = np.searchsorted(ends[order, 0], ends[:, 0] + reach_px, side="right")
    distances = []
    for i, view in enumerate(views):
        near = order[first[i] : after[i]]
        near = near[near < i]
        before = near[np.abs(ends[near] - ends[i]).max(axis=1, initial=0.0) <= reach_px]
        shortest = np.inf
        for j in before.tolist():
            shortest = min(shortest, float(np.abs(view.uv - views[j].uv).max()))
            if shortest <= SAME_PX:
                break
        distances.append(shortest)
    return distances


def _listed_images(names: Sequence[str]) -> str:
    return ", ".join(names[:LISTED]) + (" …" if len(names) > LISTED else "")
