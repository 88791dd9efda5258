"""From the centres of ellipses to the pictures of the circles' centres.

The centre of a circle's picture is not the picture of its centre: perspective and the lens both move it, in proportion
to the circle's area and the second derivatives of the map from board to image (J. Heikkila, Geometric Camera
Calibration Using Circular Control Points, PAMI 2000, for perspective alone). No camera needs to be known, as the dots
themselves show the map F: a homography H, then a polynomial P for what the lens does,

    F(x) = P(H x).

Each dot's outline is drawn through F and the ellipse nearest to it is found by least squares along the outline, as the
fit to the grey values would: its centre less F(x0) is the shift. F is fitted to the centres less their shifts, twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibrant.arrays import Array
from calibrant.geometry.projective import homography

HIGHEST_DEGREE = 6
"""Of the polynomial. Brown's k3 has degree 7, of which the first six leave next to nothing on a board."""
DOTS_A_TERM = 2.5
"""Dots there must be for each coefficient: with fewer, noise would bend the map."""
LEAST_PART = 1e-9
"""Of the largest singular value: below it, powers of a short side repeat each other."""
OUTLINE = 16
"""Points of an outline: the shift has the first harmonics alone, the map's third derivatives reach the fourth."""
ROUNDS = 3
"""The shifts are some tenths of a pixel and smooth over the board: the last round changes them by a thousandth."""

SHIFT_SHARE = 0.5
"""Error of a shift over its dot's misfit: a third to a whole on drawn boards that the polynomial does not follow."""
NOISE_REACH = 12.0
"""Square of a misfit over the variance of one axis that noise alone exceeds in one dot of 400: chi-square of two."""
AROUND = 9
"""A dot and those beside it: the map may pass through one by chance."""

_TURN = 2.0 * np.pi * np.arange(OUTLINE) / OUTLINE
_CIRCLE = np.stack([np.cos(_TURN), np.sin(_TURN)], axis=1)


@dataclass(frozen=True, eq=False)
class BoardMap:
    """F: steps of the board -> pixels. H (3, 3); middle (2,) px and half_px scale pixels to -1..1; degree, powers
    (k, 2) and coefficients (k, 2) of the polynomial; error_px: rms over both axes of dots left out of the fit;
    misfit_px (n,): distance of each dot from the map, over the root of what its place leaves free.
    """

    H: Array
    middle: Array
    half_px: float
    degree: int
    powers: NDArray[np.int64]
    coefficients: Array
    error_px: float
    misfit_px: Array

    def pixels(self, steps: Array) -> Array:
        """Pixels (..., 2) of places (..., 2) on the board."""
        w = _scaled_homography(self.H, steps, self.middle, self.half_px)
        return self.middle + self.half_px * (_monomials(w, self.powers) @ self.coefficients)


def fit_board_map(H: Array, steps: Array, uv: Array, weight: Array, degrees: range) -> BoardMap:
    """The map through dots at steps (n, 2) and pixels (n, 2), weights (n,) of their errors; n of 4 or more.

    Args: H (3, 3): homography from steps to about the pixels; degrees: those of the polynomial to choose from, by how
    well dots left out are predicted.
    """
    middle = 0.5 * (uv.min(axis=0) + uv.max(axis=0))
    half = 0.5 * float(np.ptp(uv, axis=0).max())
    scaled = _scaled_homography(H, steps, middle, half)
    b = (uv - middle) / half
    candidates: list[BoardMap] = []
    for degree in degrees:
        powers = np.array([(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)])
        if candidates and DOTS_A_TERM * len(powers) > len(uv):
            break
        A = _monomials(scaled, powers)
        # Rows of a short side do not carry every power: the least coefficients of those that fit are taken.
        U, S, Vt = np.linalg.svd(weight[:, None] * A, full_matrices=False)
        kept = LEAST_PART * S[0] < S
        U, S, Vt = U[:, kept], S[kept], Vt[kept]
        coefficients = Vt.T @ ((U.T @ (weight[:, None] * b)) / S[:, None])
        # A residual over one less its leverage is the error of the fit without that dot.
        residual, free = b - A @ coefficients, np.maximum(1.0 - (U**2).sum(axis=1), 1e-3)
        missed = weight[:, None] * residual / free[:, None]
        error = half * float(np.sqrt((missed**2).sum() / (weight**2).sum()))
        misfit = half * np.linalg.norm(residual, axis=1) / np.sqrt(free)
        candidates.append(BoardMap(H, middle, half, degree, powers, coefficients, error, misfit))
    return min(candidates, key=lambda board: board.error_px)


def true_centres(steps: Array, uv: Array, shape: Array, sigma_px: Array) -> tuple[Array, Array]:
    """Pictures of the circles' centres (n, 2) px, and their sigma_px (n,) per axis with what the map's misfit adds.

    A map that does not follow the dots is no better in its second derivatives: what a dot, or one beside it, is off it
    beyond noise goes into its sigma, times SHIFT_SHARE.
    Args: steps (n, 2): the circles on the board; uv (n, 2) px and shape (n, 2, 2) px^2 of their ellipses; sigma_px (n,)
    of the ellipses' centres.
    """
    # Shifts, and what they are off by at first, grow with a dot's area: a big dot must not bend the map to itself.
    area = np.sqrt(np.linalg.det(shape))
    weight = np.minimum(np.median(area) / area, 1.0)
    shift = np.zeros_like(uv)
    H, degrees = homography(steps, uv), range(1, HIGHEST_DEGREE + 1)
    for _ in range(ROUNDS):
        board = fit_board_map(H, steps, uv - shift, weight, degrees)
        shift, degrees = _shifts(board, steps, shape), range(board.degree, board.degree + 1)
    beyond = np.maximum(board.misfit_px**2 - NOISE_REACH * sigma_px**2, 0.0)
    near = cKDTree(steps).query(steps, k=min(AROUND, len(steps)))[1]
    beyond = beyond[np.asarray(near)].max(axis=1)
    return uv - shift, np.sqrt(sigma_px**2 + SHIFT_SHARE**2 * beyond)


def _shifts(board: BoardMap, steps: Array, shape: Array) -> Array:
    """From the pictures of circles' centres to the centres of their pictures, (n, 2) px."""
    near = board.pixels(steps[:, None] + 0.5 * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]]))
    centre, J = near[:, 0], np.stack([near[:, 1] - near[:, 2], near[:, 3] - near[:, 4]], axis=-1)
    # The ellipse's area over that of a unit circle's picture is the radius squared, in steps.
    radius = np.sqrt(np.sqrt(np.linalg.det(shape)) / np.maximum(np.abs(np.linalg.det(J)), 1e-9))
    around = radius[:, None, None] * _CIRCLE
    affine = np.einsum("nij,nkj->nki", J, around)
    bent = board.pixels(steps[:, None] + around) - centre[:, None] - affine
    along = np.einsum("nij,kj->nki", J, _CIRCLE @ np.array([[0.0, 1.0], [-1.0, 0.0]]))
    length = np.linalg.norm(along, axis=2, keepdims=True)
    normal = np.stack([along[..., 1], -along[..., 0]], axis=2) / length
    # Unknowns: the centre and the three of a symmetric stretch; weighted by length of outline, as pixels are.
    nx, ny, x, y = normal[..., 0], normal[..., 1], affine[..., 0], affine[..., 1]
    rows = np.stack([nx, ny, nx * x, ny * y, nx * y + ny * x], axis=2)
    weighted = np.swapaxes(rows * length, 1, 2)
    right = weighted @ (normal * bent).sum(axis=2)[..., None]
    return np.asarray(np.linalg.solve(weighted @ rows, right)[:, :2, 0])


def _scaled_homography(H: Array, steps: Array, middle: Array, half: float) -> Array:
    q = np.concatenate([steps, np.ones((*steps.shape[:-1], 1))], axis=-1) @ H.T
    return (q[..., :2] / q[..., 2:] - middle) / half


def _monomials(w: Array, powers: NDArray[np.int64]) -> Array:
    """x^i y^j of places (..., 2) for powers (k, 2), (..., k)."""
    flat = np.ascontiguousarray(w.reshape(-1, 2).T)
    raised = [np.ones_like(flat)]
    for _ in range(int(powers.max())):
        raised.append(raised[-1] * flat)
    columns = np.stack([raised[i][0] * raised[j][1] for i, j in powers.tolist()])
    return np.asarray(columns.T.reshape(*w.shape[:-1], len(powers)))
