"""Corners of dark squares on a light ground from their edges: profiles across each side, a line a side, crossings.

A profile across an edge goes from the border's ink to the paper; the edge lies where the integral of the brightness
says it does, x = right - (sum above ink) / (paper - ink), whatever the blur. A line, bent as a lens bends it, is fitted
to each side's profiles, away from the corners that blur rounds; two of them cross in a corner. Its standard deviation
follows from the scatter of the profiles about their lines.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Grey
from calibrant.detection.opencv import sample

PROFILES = 24
"""Along a side: about one a pixel of a small marker; their noise is independent when a pixel or more apart."""
SAMPLES = 17
"""Across an edge."""
ALONG = (0.12, 0.88)
"""Part of a side that is used: blur and the neighbouring side reach into the rest."""
FIND_PX = 12.0
"""Half length of the profiles that find an edge: a contour may run half a threshold's window away from it."""
MEASURE_PX = (6.0, 4.0)
"""Half lengths of the profiles that measure it, the last with a sample every half pixel."""
RISES = 3.0
"""Half length of the profiles that measure over half the edge's rise, from 16 to 84 %, where that is more: a picture
taken on the move smears an edge further than they reach, and without its plateaus the edge would seem elsewhere."""
SHARED_PX = 1.5
"""Profiles nearer to each other read the same pixels: n of them spaced by d then tell no more than n d / SHARED_PX do.
Between pixels a bilinear value has 2/3 of a pixel's variance, the mean along an edge of length L one of L pixels."""
LEAST_STEP = 8.0
"""Grey levels between ink and paper: a few times the noise."""
NEIGHBOUR = 0.1
"""Part of the step by which a plateau may fall off towards its end: uneven light does less, another surface more."""
STRAIGHT = 2.5
"""Profiles further off their line than this many standard deviations are left out: something lies on the edge there."""
PROFILE_SIGMA_PX = 0.1
BEND = 0.02
"""How far a lens bends a side, as a part of its length, against the sigma of one profile: a prior on the parabola."""
FLOOR_PX = 0.02
"""No print and no lens is better."""


def refine_quads(grey: Grey, corners: Array, *, reach: float) -> tuple[Array, Array]:
    """Corners (n, 4, 2) px, in order around each square, moved onto its edges; and their sigma_px (n, 4).

    Args: reach: how far profiles may go to each side of an edge, as a part of the square's size: within the border of
    ink and within the paper around. Sigma is infinite where the edges cannot be seen.
    """
    found = np.asarray(corners, dtype=np.float64)
    sigma = np.full(found.shape[:2], np.inf)
    if len(found) == 0:
        return found, sigma
    uv, rise = found.copy(), np.zeros(found.shape[:2])
    for half_px, offsets in ((FIND_PX, _steepest), *((px, _by_area) for px in MEASURE_PX)):
        side = np.roll(uv, -1, axis=1) - uv
        half = np.clip(reach * depth(uv, side), 1.5, np.maximum(half_px, RISES * rise))
        value, normal = profiles(grey, uv, side, -half, half)
        rise = half * _rise(value)
        part, seen = offsets(value)
        crossing, spread = crossings(uv, side, normal, part * half[..., None], seen)
        near = np.linalg.norm(crossing - found, axis=2) < 2.0 * FIND_PX
        good = near & np.isfinite(spread)
        sigma = np.where(good, spread, np.inf)
        uv = np.where(good[..., None], crossing, uv)
    return uv, sigma


def crossings(
    uv: Array, side: Array, normal: Array, offset: Array, seen: NDArray[np.bool_], shared: Array | float = 1.0
) -> tuple[Array, Array]:
    """Where the sides' lines cross, (n, 4, 2) px, with sigma_px (n, 4), infinite where a side is not seen.

    Args: uv (n, 4, 2): corners; side, normal (n, 4, 2): as of them; offset, seen (n, 4, PROFILES): how far outwards
    the edge lies at each profile, px, and whether it shows there; shared (n, 4): by what factor a side is less certain
    than its profiles' scatter says, for what they share.
    """
    first, last, spread = _tangents(uv, side, normal, offset, seen)
    spread = spread * shared
    # Corner k is where side k - 1 ends and side k begins.
    crossing, sine = _crossings(np.roll(last, 1, axis=1), first)
    both = spread**2 + np.roll(spread, 1, axis=1) ** 2
    sigma = np.sqrt(0.5 * both + FLOOR_PX**2) / np.maximum(sine, 1e-3)
    return crossing, np.where(np.isfinite(crossing).all(axis=2), sigma, np.inf)


def depth(uv: Array, side: Array) -> Array:
    """How deep the square is across each side (n, 4), px: a slanted one is narrower than its sides are long."""
    u, v = side[..., 0], side[..., 1]
    others = np.stack([np.roll(uv, -2, axis=1), np.roll(uv, -3, axis=1)]) - uv
    distance = np.abs(u * others[..., 1] - v * others[..., 0]) / np.maximum(np.hypot(u, v), 1e-9)
    return np.asarray(distance.min(axis=0))


def profiles(
    grey: Grey | NDArray[np.float32], uv: Array, side: Array, first: Array, last: Array
) -> tuple[Array, Array]:
    """Grey values (n, 4, PROFILES, SAMPLES) across the sides, and outward normals (n, 4, 2).

    Args: first, last (n, 4): where profiles begin and end, px outwards of the side.
    """
    tangent = side / np.maximum(np.linalg.norm(side, axis=2), 1e-9)[..., None]
    # Corners go clockwise (y down): the outward normal is the tangent turned back by 90 degrees.
    normal = np.stack([tangent[..., 1], -tangent[..., 0]], axis=-1)
    foot = uv[:, :, None] + np.linspace(*ALONG, PROFILES)[:, None] * side[:, :, None]
    across = first[..., None, None] + (last - first)[..., None, None] * np.linspace(0.0, 1.0, SAMPLES)
    at = foot[:, :, :, None] + across[..., None] * normal[:, :, None, None]
    return sample(grey, at.reshape(4 * len(uv), -1, 2)).reshape(at.shape[:-1]), normal


def _steepest(value: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Where profiles rise most, -1 ... 1, and whether they do: from ink to paper, nothing else rises outwards there."""
    rise = value[..., 2:] - value[..., :-2]
    top = np.argmax(rise, axis=-1)
    return np.linspace(-1.0, 1.0, SAMPLES)[1:-1][top], rise.max(axis=-1) > 0.5 * LEAST_STEP


def _by_area(value: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Where the edge must be for the ink's area under the profiles, -1 ... 1, and whether it is seen."""
    value = _without_neighbours(value)
    ink, paper = value[..., :3].mean(axis=-1), value[..., -3:].mean(axis=-1)
    step = paper - ink
    missing = (paper[..., None] - value) / np.where(np.abs(step) > 1e-6, step, 1.0)[..., None]
    width = (missing.sum(axis=-1) - 0.5 * (missing[..., 0] + missing[..., -1])) * (2.0 / (SAMPLES - 1))
    offset = width - 1.0
    return offset, (step > LEAST_STEP) & (np.abs(offset) < 1.0)


def _rise(value: Array) -> Array:
    """Half of where the sides' mean profiles rise from 16 to 84 %, (n, 4), over a profile's half length."""
    mean = _without_neighbours(value).mean(axis=2)
    ink, paper = mean[..., :3].mean(axis=-1, keepdims=True), mean[..., -3:].mean(axis=-1, keepdims=True)
    part = (mean - ink) / np.maximum(paper - ink, 1e-6)
    between = (part[..., 1:] > 0.16) & (part[..., 1:] < 0.84)
    return np.asarray(between.sum(axis=-1) / (SAMPLES - 1.0))


def _without_neighbours(value: Array) -> Array:
    """Profiles that end on the ink's and the paper's plateau, where a side's own reach further: onto a table, a cell.

    The mean profile of a side, whose noise is a fifth, says where; what lies beyond takes the plateau's brightness.
    """
    middle, index = SAMPLES // 2, np.arange(SAMPLES)
    mean = value.mean(axis=2)
    top = middle + 2 + np.argmax(mean[..., middle + 2 :], axis=-1)
    bottom = np.argmin(mean[..., : middle - 1], axis=-1)
    light, dark = (np.take_along_axis(mean, at[..., None], axis=-1)[..., 0] for at in (top, bottom))
    allowed = NEIGHBOUR * (light - dark)
    top = np.where(light - mean[..., -3:].mean(axis=-1) > allowed, top, SAMPLES - 1)
    bottom = np.where(mean[..., :3].mean(axis=-1) - dark > allowed, bottom, 0)
    inside = np.clip(index, bottom[..., None], top[..., None])
    return np.take_along_axis(value, np.broadcast_to(inside[:, :, None], value.shape), axis=-1)


def _tangents(
    uv: Array, side: Array, normal: Array, offset: Array, seen: NDArray[np.bool_]
) -> tuple[Array, Array, Array]:
    """Parabolas offset = p . (1, s, s^2) fitted to the profiles of each side, as tangents at s = -1/2 and 1/2.

    Returns: lines (n, 4, 3) a u + b v = c at the sides' beginnings and ends, and their sigma (n, 4), px, there.
    """
    s = np.linspace(*ALONG, PROFILES) - 0.5
    basis = np.stack([np.ones_like(s), s, s**2], axis=-1)
    length = np.linalg.norm(side, axis=-1)
    prior = np.zeros((*length.shape, 3, 3))
    prior[..., 2, 2] = (PROFILE_SIGMA_PX / (BEND * np.maximum(length, 1.0))) ** 2
    weight = seen.astype(np.float64)
    for _ in range(2):
        N = np.einsum("...k,ka,kb->...ab", weight, basis, basis) + prior + 1e-9 * np.eye(3)
        cofactors = np.linalg.inv(N)
        p = np.einsum("...ab,kb,...k,...k->...a", cofactors, basis, weight, offset, optimize=True)
        residual = offset - p @ basis.T
        count = weight.sum(axis=-1)
        scatter = np.sqrt((weight * residual**2).sum(axis=-1) / np.maximum(count - 3, 1))
        near = np.abs(residual) <= np.maximum(STRAIGHT * scatter, FLOOR_PX)[..., None]
        weight = (seen & near).astype(np.float64)
    end = np.array([1.0, 0.5, 0.25])
    spread = scatter * np.sqrt(np.einsum("a,...ab,b->...", end, cofactors, end))
    apart = length * (ALONG[1] - ALONG[0]) / (PROFILES - 1)
    spread *= np.sqrt(np.maximum(1.0, SHARED_PX / np.maximum(apart, 1e-9)))
    lines = []
    for at in (-0.5, 0.5):
        here = p @ np.array([1.0, at, at**2])
        slope = p @ np.array([0.0, 1.0, 2.0 * at])
        point = uv + (at + 0.5) * side + here[..., None] * normal
        direction = side + slope[..., None] * normal
        a, b = direction[..., 1], -direction[..., 0]
        size = np.maximum(np.hypot(a, b), 1e-9)
        lines.append(np.stack([a, b, a * point[..., 0] + b * point[..., 1]], axis=-1) / size[..., None])
    return lines[0], lines[1], np.where(count >= PROFILES // 2, spread, np.inf)


def _crossings(one: Array, other: Array) -> tuple[Array, Array]:
    """Where lines (n, 4, 3) meet, (n, 4, 2), and the sine of their angle, (n, 4)."""
    det = one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]
    safe = np.where(np.abs(det) > 1e-6, det, np.nan)
    u = (one[..., 2] * other[..., 1] - one[..., 1] * other[..., 2]) / safe
    v = (one[..., 0] * other[..., 2] - one[..., 2] * other[..., 0]) / safe
    return np.stack([u, v], axis=-1), np.abs(det)
