"""Then over now: a picture by which a camera is brought back by hand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrant.data import CalibrationResult
from calibrant.data.details import Changes
from calibrant.opencv import cv2
from calibrant.verification.unchanged.pictures import Reference

ARROW, END = (40, 90, 255), (80, 220, 80)
"""Colours of an arrow and of where it should end, BGR."""
SHOWN_PX = 12.0
"""Shortest arrow that an eye follows in a picture 1000 pixels wide: smaller movements are magnified to it."""
STEPS = (1, 2, 5, 10, 20, 50, 100)


def drawn(found: CalibrationResult, reference: Reference | None, now: Reference) -> NDArray[np.uint8]:
    """The photo of now (h, w, 3) BGR, the reference in red through it where there is one, and arrows from where points
    are to where they should be, magnified as the words at the bottom say."""
    changes = found.detail(Changes)
    canvas = np.repeat(now.grey[..., None], 3, axis=2)
    if reference is not None:
        then = cv2.resize(reference.grey, (now.grey.shape[1], now.grey.shape[0]), interpolation=cv2.INTER_LINEAR)
        # Where both agree the picture is grey; what moved has a red and a blue rim.
        canvas = np.stack([now.grey, now.grey // 2 + then // 2, then], axis=2)
    photo = next((p for p in changes.photos if p.id == now.name), None) if changes is not None else None
    canvas = np.ascontiguousarray(canvas)
    if photo is None or not photo.found_px:
        return canvas
    found_px, expected = np.array(photo.found_px), np.array(photo.expected_px)
    step = expected - found_px
    unit = max(canvas.shape[1] / 1000, 0.6)
    factor = magnification(step, unit)
    for at, d in zip(found_px, step):
        end = at + factor * d
        a, b = ((round(float(p[0])), round(float(p[1]))) for p in (at, end))
        cv2.arrowedLine(canvas, a, b, ARROW, max(1, round(1.5 * unit)), cv2.LINE_AA, tipLength=0.3)
        cv2.circle(canvas, b, max(1, round(1.5 * unit)), END, -1, cv2.LINE_AA)
    mean = step.mean(axis=0)
    sides = f"{abs(mean[0]):.1f} px {'right' if mean[0] > 0 else 'left'}, {abs(mean[1]):.1f} px "
    text = f"the picture has to move {sides}{'down' if mean[1] > 0 else 'up'} (arrows x {factor})"
    band = round(34 * unit)
    canvas[-band:] = canvas[-band:] // 4
    at = (round(10 * unit), canvas.shape[0] - round(11 * unit))
    white = (255, 255, 255)
    cv2.putText(canvas, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.7 * unit, white, max(1, round(unit)), cv2.LINE_AA)
    return canvas


def magnification(step: NDArray[np.float64], unit: float) -> int:
    """By what arrows are magnified, a round number, so that the typical one is seen. Args: unit, pixels of a thousandth
    of the picture's width."""
    typical = float(np.median(np.linalg.norm(step, axis=1)))
    return next((k for k in STEPS if k * typical >= SHOWN_PX * unit), STEPS[-1])
