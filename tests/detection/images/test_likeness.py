"""Views that repeat each other are named."""

from __future__ import annotations

import numpy as np

from calibrant.data import View
from calibrant.detection.images.likeness import notes_on_likeness


def view(name: str, uv: np.ndarray) -> View:
    """A view of points at these pixels."""
    return View(name, np.zeros((len(uv), 3)), uv, np.arange(len(uv)))


def test_copies_and_still_boards_are_told_apart() -> None:
    uv = np.random.default_rng(0).uniform(0, 600, (20, 2))
    views = [view("a", uv), view("b", uv), view("c", uv + 0.5), view("d", uv + 30), view("e", uv[:10])]
    notes = notes_on_likeness(views, 640)
    assert len(notes) == 2
    assert "1 of 5 pictures show exactly" in notes[0]
    assert ": b." in notes[0]
    assert ": c." in notes[1]
    assert notes_on_likeness([views[0], views[3], views[4]], 640) == ()
