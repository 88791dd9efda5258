"""Matches drawn with the lines that their partners must lie on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.geometry import projective, se3
from calibrant.opencv import cv2
from calibrant.perceive.stereo.drawing import COLOURS, colour_of

SHOWN = 24
"""Matches drawn: lines of more cannot be told apart."""
_BITS = 4
_DEPTHS = np.geomspace(0.05, 1e4, 400)
"""Distances along a ray, in baselines, at which its line is drawn."""

Line = Callable[[Array], Array]
"""From a pixel (2,) of one picture to points (m, 2) of its line in the other."""


def line_of_matrix(F_b_a: Array, image_size: tuple[int, int]) -> Line:
    """Straight lines by F, from the left to the right edge (or the upper to the lower one) of picture b."""

    def line(uv: Array) -> Array:
        a, b, c = projective.epipolar_lines(F_b_a, uv)
        run = np.linspace(-0.5, (image_size[0] if abs(b) > abs(a) else image_size[1]) - 0.5, 50)
        across = -(c + (a if abs(b) > abs(a) else b) * run) / (b if abs(b) > abs(a) else a)
        return np.stack([run, across] if abs(b) > abs(a) else [across, run], axis=1)

    return line


def line_of_cameras(cameras: Sequence[Camera], T_b_a: Array) -> Line:
    """Lines bent as the lens of camera b bends them."""
    length = float(np.linalg.norm(T_b_a[:3, 3]))

    def line(uv: Array) -> Array:
        p = se3.apply(T_b_a, cameras[0].unproject(uv) * (_DEPTHS * length)[:, None])
        model, values = cameras[1].model, cameras[1].values
        known = model.sees(values, p) & model.inside(values, p)
        return np.where(known[:, None], cameras[1].project(np.where(known[:, None], p, [0.0, 0.0, 1.0])), np.nan)

    return line


def drawn_lines(images: Sequence[NDArray[Any]], uv: Array, lines: tuple[Line, Line]) -> NDArray[np.uint8]:
    """Both pictures side by side, (h, w, 3) BGR: matches as dots, in each the lines of the other's.

    uv (2, n, 2): the matches; lines: from the first picture into the second, and back.
    """
    canvases = [colour_of(image).copy() for image in images]
    order = np.argsort(uv[0, :, 0] * 0.754877 % 1 + uv[0, :, 1] * 0.569840 % 1, kind="stable")[:SHOWN]
    for k, i in enumerate(order):
        colour = COLOURS[k % len(COLOURS)]
        for side, canvas in enumerate(canvases):
            _polyline(canvas, lines[1 - side](uv[1 - side, i]), colour)
            u, v = (round(float(c)) for c in uv[side, i])
            cv2.circle(canvas, (u, v), max(3, canvas.shape[1] // 200), colour, -1, cv2.LINE_AA)
    height = max(c.shape[0] for c in canvases)
    return np.concatenate([np.pad(c, ((0, height - c.shape[0]), (0, 0), (0, 0))) for c in canvases], axis=1)


def _polyline(canvas: NDArray[np.uint8], line: Array, colour: tuple[int, int, int]) -> None:
    h, w = canvas.shape[:2]
    with np.errstate(invalid="ignore"):
        near = np.all((line > [-w, -h]) & (line < [2 * w, 2 * h]), axis=1)
    for piece in np.split(line, np.flatnonzero(np.diff(near.astype(np.int8))) + 1):
        if len(piece) > 1 and np.isfinite(piece).all() and np.abs(piece).max() < 2**14:
            points = np.rint(piece * 2**_BITS).astype(np.int32)
            cv2.polylines(canvas, [points], False, colour, max(1, w // 800), cv2.LINE_AA, _BITS)
