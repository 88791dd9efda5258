"""The motion that most of a picture agrees on, and how certain it is.

Things in the scene move too, so that matches are not asked to agree: of motions drawn from pairs of matches (shift,
turn, scale; Fischler and Bolles 1981) the one wins that matches in the most cells of the picture follow. Cells count,
not matches: a printed page is no more of the scene than the wall behind it. What moved otherwise is looked for in the
rest.

The motion is then a map of first or, in many cells, second order fitted to the matches that follow it, and is told at
the picture's middle. Its covariance is that of leaving out one cell after the other (the jackknife), since matches of
one place err alike:

    C = (c - 1) / c sum_k (m_k - mean)(m_k - mean)^T
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.optimize.chances import f_tail

COLUMNS, ROWS = 10, 8
DRAWS = 1500
"""Pairs of matches that are tried: where a fifth of them follow the scene, one in 25 pairs is right."""
LEAST_CELLS = 6
"""An affine map has three times two numbers: fewer places than twice its points of support hold no jackknife."""
LEAST_MATCHES = 12
BENT_CELLS = 15
"""From which on the motion may be bent, as perspective and a lens bend that of a camera that was turned: 5 per cent at
the middle of a picture 60 deg wide."""
NEAR = 2.5e-3
"""Of the picture's longer side: how far a match may be from the motion that it follows; 3 px of 1280. Depth and the
lens bend a motion by more than features err."""
BEND = 0.08
"""Of the motion itself, that it may be bent by: what depth makes of a camera that was moved rather than turned."""
APART = 3.0
"""Times as far off as a match that follows may be, from which on one follows something else: those between are poor."""
RIVAL = 0.7
"""A second motion in more than this part of the first one's cells: which is the scene, and which is what moved in it,
cannot be told."""
LEAST_SIGMA_PX = 0.02
"""Of a shift: resampling alone moves features by this much of a pixel."""


@dataclass(frozen=True, eq=False)
class Motion:
    """What became of a picture, pixels of the full picture.

    shift (2,) of its middle, to the right and down; turn, radians clockwise; scale, 1 for none; covariance (4, 4) of
    (shift, turn, relative scale). chance: of as much where nothing moved. then, now (m, 2): matches that follow it.
    otherwise: matches of something in the scene that moved by itself, as (then, now); empty for none.
    """

    shift: Array
    turn: float
    scale: float
    covariance: Array
    chance: float
    then: Array
    now: Array
    cells: int
    otherwise: tuple[Array, Array]


def motion(then: Array, now: Array, image_size: tuple[int, int]) -> Motion:
    """The motion of a picture from matches (m, 2) of then and of now.

    Raises: InputError where too little agrees, or two motions do about equally.
    """
    size = np.array(image_size, dtype=np.float64)
    if len(then) < LEAST_MATCHES:
        raise InputError(
            f"only {len(then)} features of the reference are found again, at least {LEAST_MATCHES} are needed: the "
            "scene has too little texture, it is dark, the camera is covered, or it looks elsewhere; put something "
            "with print or edges into view that stands still, and light it"
        )
    cells = _cells(then, size)
    off = _consensus(then, now, cells, size)
    follows = off < 1
    agreeing = len(np.unique(cells[follows]))
    if follows.sum() < LEAST_MATCHES or agreeing < LEAST_CELLS:
        raise InputError(
            f"the reference and the photo agree on no motion: of {len(then)} features found again {int(follows.sum())} "
            f"in {agreeing} of {COLUMNS * ROWS} parts of the picture move alike. Does the photo show the same scene? A "
            "camera on the robot must be at the pose it was at for the reference"
        )
    rest = off > APART
    other = np.zeros(len(then), dtype=np.bool_)
    if rest.sum() >= LEAST_MATCHES:
        other[rest] = _consensus(then[rest], now[rest], cells[rest], size) < 1
        rival = len(np.unique(cells[other]))
        if rival > RIVAL * agreeing and other.sum() >= LEAST_MATCHES:
            raise InputError(
                f"two parts of the picture moved differently ({agreeing} and {rival} of {COLUMNS * ROWS}): which is "
                "the scene and which moved in it cannot be told; take the photo with the robot and all things as they "
                "were for the reference"
            )
        if other.sum() < LEAST_MATCHES:
            other[:] = False
    return _told(then[follows], now[follows], cells[follows], size, (then[other], now[other]))


def _cells(at: Array, size: Array) -> NDArray[np.int64]:
    place = np.clip((at + 0.5) / size * (COLUMNS, ROWS), 0, (COLUMNS - 1, ROWS - 1)).astype(np.int64)
    cells: NDArray[np.int64] = place[:, 1] * COLUMNS + place[:, 0]
    return cells


def _consensus(then: Array, now: Array, cells: NDArray[np.int64], size: Array) -> Array:
    """How far each match is off the motion that most cells agree on, 1 for as far as one that follows it may be."""
    rng = np.random.default_rng(0)  # the same pictures give the same answer
    a, b = rng.integers(len(then), size=(2, DRAWS))
    span = float(size.max())
    z, w = then @ (1, 1j), now @ (1, 1j)
    apart = np.abs(z[a] - z[b]) > 0.1 * span
    a, b = a[apart], b[apart]
    if not len(a):
        return np.full(len(then), np.inf)
    factor = (w[a] - w[b]) / (z[a] - z[b])
    sane = (np.abs(factor) > 0.5) & (np.abs(factor) < 2.0)
    a, factor = a[sane], factor[sane]
    best, most = np.full(len(then), np.inf), (0, 0)
    for first, f in zip(a, factor):
        predicted = w[first] + f * (z - z[first])
        off = np.abs(w - predicted) / (NEAR * span + BEND * np.abs(predicted - z))
        follows = off < 1
        score = (int(np.count_nonzero(np.bincount(cells[follows], minlength=COLUMNS * ROWS))), int(follows.sum()))
        if score > most:
            best, most = off, score
    return best


def _told(then: Array, now: Array, cells: NDArray[np.int64], size: Array, otherwise: tuple[Array, Array]) -> Motion:
    """The motion of matches that follow one, with its jackknife over cells."""
    middle, span = (size - 1) / 2, float(size.max())
    x = (then - middle) / span
    names = np.unique(cells)
    bent = len(names) >= BENT_CELLS
    whole = _fitted(x, now - then, np.ones(len(then)), bent=bent)
    parts = np.stack([_fitted(x, now - then, (cells != k).astype(np.float64), bent=bent) for k in names])
    count = len(names)
    values = np.stack([_figures(p, span) for p in (whole, *parts)])
    off = values[1:] - values[1:].mean(axis=0)
    C = (count - 1) / count * off.T @ off
    C += np.diag([LEAST_SIGMA_PX, LEAST_SIGMA_PX, LEAST_SIGMA_PX / span, LEAST_SIGMA_PX / span]) ** 2
    d = values[0]
    spare = count - 1 - 4
    # Hotelling: a covariance of as many cells is itself uncertain.
    square = float(d @ np.linalg.solve(C, d)) * max(spare, 1) / (4 * (count - 1))
    chance = float(f_tail(4, max(spare, 1), square))
    return Motion(d[:2], float(d[2]), 1.0 + float(d[3]), C, chance, then, now, count, otherwise)


def _fitted(x: Array, step: Array, weight: Array, *, bent: bool) -> Array:
    """Coefficients (k, 2) of step = (1, x, y) c, bent: and of (x^2, x y, y^2), by Tukey's biweight."""
    A = np.concatenate([np.ones((len(x), 1)), x], axis=1)
    if bent:
        A = np.concatenate([A, x**2, x[:, :1] * x[:, 1:]], axis=1)
    c, w = np.zeros((A.shape[1], 2)), weight
    for _ in range(8):
        root = np.sqrt(w)[:, None]
        c = np.linalg.lstsq(A * root, step * root)[0]
        r = np.linalg.norm(step - A @ c, axis=1)
        scale = max(float(np.median(r[weight > 0])) / 1.1774, 0.02)
        u = np.minimum(r / (4.685 * scale), 1.0)
        w = weight * (1 - u**2) ** 2
    return c


def _figures(c: Array, span: float) -> Array:
    """(right, down, turn clockwise, relative scale) of a step at the middle, in units of the span."""
    turn = 0.5 * (c[1, 1] - c[2, 0]) / span
    scale = 0.5 * (c[1, 0] + c[2, 1]) / span
    return np.array([c[0, 0], c[0, 1], turn, scale])
