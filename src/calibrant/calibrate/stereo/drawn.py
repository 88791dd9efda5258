"""Pairs of pictures with the epipolar lines of some of their points, as curves: a lens bends them.

What one camera sees at a pixel lies on its ray, p(s) = s d, and the other camera sees the ray as project(T p(s)), s
from near to far. Drawn in the pictures as they were taken, it passes through the point's partner.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.stereo.pairs import Seen, seen_by_both
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.data.details import EpipolarErrors, StereoGeometry
from calibrant.geometry import se3

POINTS = 8
"""Lines of a picture that an eye follows."""
STEPS = 160
"""Places along a ray; straight pieces between them are a few pixels long."""
NEAR, FAR = 0.05, 200.0
"""Of the distance of the target: from under the lens to what is as good as infinite."""
BEYOND = 0.02
"""How far a curve is followed outside the picture, of its width."""


@dataclass(frozen=True, eq=False)
class DrawnPair:
    """Points (n, 2) that both saw, in each picture, with the curve (k, 2) of each one's partner there.

    left, right: (camera, view id); sizes (width, height); rms_px: of the pair's distances from the lines.
    """

    left: tuple[str, str]
    right: tuple[str, str]
    size_left: tuple[int, int]
    size_right: tuple[int, int]
    uv_left: Array
    uv_right: Array
    curves_left: tuple[Array, ...]
    curves_right: tuple[Array, ...]
    rms_px: float


def drawn_pairs(result: CalibrationResult) -> tuple[DrawnPair, ...]:
    """The pairs of a stereo result, the one with the largest errors first; nothing for other kinds."""
    pair, errors, seen = result.detail(StereoGeometry), result.detail(EpipolarErrors), result.observations
    if pair is None or errors is None or seen is None:
        return ()
    left, right = result.cameras[pair.left], result.cameras[pair.right]
    T = result.transform(pair.left, pair.right).matrix
    views = [[v for v in seen.views if v.camera == name] for name in (pair.left, pair.right)]
    both = [p for p in seen_by_both(*views) if p.moment in errors.pairs]
    both.sort(key=lambda p: -errors.pairs[p.moment].rms_px)
    return tuple(_drawn((pair.left, pair.right), p, left, right, T, rms_px=errors.pairs[p.moment].rms_px) for p in both)


def _drawn(
    names: tuple[str, str], p: Seen, left: Camera, right: Camera, T_left_right: Array, *, rms_px: float
) -> DrawnPair:
    some = spread_out(p.uv_left, POINTS)
    a, b = p.uv_left[some], p.uv_right[some]
    away = 4 * float(np.linalg.norm(T_left_right[:3, 3])) + 1e-3
    return DrawnPair(
        (names[0], p.left),
        (names[1], p.right),
        left.image_size,
        right.image_size,
        a,
        b,
        tuple(epipolar_curve(right, left, T_left_right, uv, away, through=other) for uv, other in zip(b, a)),
        tuple(
            epipolar_curve(left, right, se3.inverse(T_left_right), uv, away, through=other) for uv, other in zip(a, b)
        ),
        rms_px,
    )


def spread_out(uv: Array, count: int) -> list[int]:
    """Points (n, 2) far from each other: the first, then always the one that is furthest from those chosen."""
    chosen = [int(np.argmin(uv.sum(axis=1)))]
    distance = np.linalg.norm(uv - uv[chosen[0]], axis=1)
    while len(chosen) < min(count, len(uv)):
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(uv - uv[chosen[-1]], axis=1))
    return chosen


def epipolar_curve(
    seer: Camera, other: Camera, T_other_seer: Array, uv: Array, away: float, *, through: Array
) -> Array:
    """Where the other camera sees the ray of a pixel (2,) of `seer`: (k, 2) in its picture, from near to far.

    away: a typical distance, metres. through: the piece that passes by this pixel (2,) alone: far outside the picture
    a lens model may turn back into it.
    """
    ray = seer.unproject(uv)
    s = away * np.geomspace(NEAR, FAR, STEPS)
    curve = other.project(se3.apply(T_other_seer, s[:, None] * ray))
    width, height = other.image_size
    edge = BEYOND * width
    with np.errstate(invalid="ignore"):
        inside = np.all((curve > -edge) & (curve < np.array([width, height]) + edge), axis=1)
    there = np.flatnonzero(inside)
    if not len(there):
        return np.zeros((0, 2))
    pieces = np.split(there, np.flatnonzero(np.diff(there) > 1) + 1)
    nearest = there[int(np.argmin(np.sum((curve[there] - through) ** 2, axis=1)))]
    return np.asarray(curve[next(piece for piece in pieces if nearest in piece)])
