"""Is it one camera? Lenses of groups of views compared, in their own scatter: two cameras, a refocus, crops, mirrors,
another mode of the sensor.

Each candidate group is given a scale, a shift or a height of the image of its own. A difference counts when it is
beyond what pixel noise makes of it, and beyond what the views scatter within the groups: points of a view err alike (a
board that is not flat, a detector's bias), which moves every view's own lens without making groups of them. The scatter
is taken from leaving out one view after the other, and the chance from Hotelling's T^2 with the degrees of freedom that
two groups of unequal scatter leave (Nel and Van der Merwe 1986). Fewer than six views are asked by `few_views`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Indices, Mask
from calibrant.calibrate.review.few_views import parted
from calibrant.calibrate.review.splits import CHOICES, Split, clustered_splits, named_splits, ordered_splits
from calibrant.calibrate.review.view_scores import (
    ASKEW,
    ASPECT,
    BEND,
    CENTRE,
    STRETCH,
    ZOOM,
    Estimate,
    OwnOfViews,
    ViewScores,
    estimate,
    kept_columns,
    only_in,
    own_of_views,
)
from calibrant.data import Check
from calibrant.optimize.chances import chi2_tail, f_tail, t_tail

NAME = "one-camera"
_LOOK = 0.05
"""Chance of the views' own lenses together from which groups are looked for: a difference that counts is far below."""
_BEYOND_NOISE = 1e-6
"""Chance, over all partings tried, that white noise alone makes the difference: none in a million calibrations."""
_BEYOND_SCATTER = 5e-3
"""The same against the scatter of the views: one false word in two hundred sets whose views err alike."""
_HELD = 0.05
"""The same, from which on a difference that is beyond noise is in sigma without a word: it may be none."""
_CERTAIN = 1e-4
"""Chance below which groups that matter are refused, and a single view is accused: one in ten thousand sets whose views
err alike. Above it a difference of groups is named, and in sigma."""
_MATTERS = 1e-3
"""Difference of two lenses, over the focal length, rms over the points seen, from which no one sigma should stand for
both: a milliradian is a millimetre at a metre."""
_FEWEST_VIEWS = 6


@dataclass(frozen=True, eq=False)
class Groups:
    """Two groups of views and their lenses: second (n,), chance of as much without groups, values (2, 4) of fx, fy, cx,
    cy with their sigmas, apart: their difference in radians; in_height: they are scaled in height alone."""

    second: Mask
    chance: float
    values: Array
    sigmas: Array
    apart: float
    in_height: bool = False


@dataclass(frozen=True, eq=False)
class OneCamera:
    """The answer: the check, and the covariance (k, k) that groups below what matters add to the lens's."""

    check: Check
    between: Array | None = None


def one_camera(scores: ViewScores, names: Sequence[str]) -> OneCamera:
    """Whether all views have one lens. Args: names, the views' files or ids, in the order of the scores."""
    if len(scores) < _FEWEST_VIEWS:
        return _of_few(scores, names)
    lenses = own_of_views(scores, ZOOM, CENTRE, ASPECT)
    said = f"no group of the {len(scores)} views (by name, order, every second, alike) has a lens of its own"
    fine = OneCamera(Check(NAME, "ok", said, 1.0))
    if lenses.chance > _LOOK:
        return fine
    groups = _groups(scores, names, lenses)
    if groups is not None and groups.chance < _BEYOND_SCATTER:
        return _told(scores, groups, names)
    # A single view of another height is one that moved while it was read out: the shutter is asked of it.
    alone = _single(scores, own_of_views(scores, ZOOM, CENTRE), names)
    return alone or (fine if groups is None else _told(scores, groups, names))


def _of_few(scores: ViewScores, names: Sequence[str]) -> OneCamera:
    """The same of three to five views, every parting tried; never refused, their scatter is too rough."""
    chance, split, own = parted(scores)
    if chance < _CERTAIN:
        groups = _lenses_of(scores, split, chance, in_height=own == (ASPECT,))
        if groups is not None and groups.apart > _MATTERS:
            return _told(scores, groups, names, refuse=False)
    said = f"no parting of the {len(scores)} views explains what their lenses differ by, as far as so few can tell"
    return OneCamera(Check(NAME, "ok", said, min(chance, 1.0)))


def _groups(scores: ViewScores, names: Sequence[str], lenses: OwnOfViews) -> Groups | None:
    """The parting that is least likely by chance, of those that may be none."""
    found: list[tuple[float, Split, tuple[str, ...]]] = []
    for own in CHOICES:
        for split in (*named_splits(names), *ordered_splits(scores, own), *clustered_splits(scores, own, lenses)):
            noise, scatter = _chances(scores, split, own)
            if noise < _BEYOND_NOISE and scatter < _BEYOND_SCATTER:
                found.append((scatter, split, own))
            elif noise < _BEYOND_SCATTER and scatter < _HELD:
                found.append((max(scatter, _BEYOND_SCATTER), split, own))
    for chance, split, own in sorted(found, key=lambda item: item[0]):
        groups = _lenses_of(scores, split, chance, in_height=own == (ASPECT,))
        if groups is not None:
            return groups
    return None


def _chances(scores: ViewScores, split: Split, own: tuple[str, ...]) -> tuple[float, float]:
    """Chances of the difference over all partings of its kind: from white noise, and from what the views scatter.

    What bends the board is free, so that views which tilt it differently are no groups; and what stretches it where
    heights are compared, so that views which roll it differently are none.
    """
    tried = split.tried * len(CHOICES)
    columns, mine = kept_columns(scores, *own)
    weights = only_in(scores, columns, mine, split.second)
    found = estimate(scores, columns, weights)
    noise = 1.0 if found is None else chi2_tail(len(mine), found.chi_square(mine)) * tried
    if noise > _BEYOND_SCATTER:
        return 1.0, 1.0
    worst, q = 0.0, len(mine)
    boards: tuple[tuple[str, ...], ...] = ((), (BEND,), (STRETCH, ASKEW))
    for more in boards if own == (ASPECT,) else boards[:2]:
        columns, mine = kept_columns(scores, *more, *own)
        mine = mine[-q:]
        found = estimate(scores, columns, only_in(scores, columns, mine, split.second), leave_out=True)
        if found is None or found.moved is None:
            if more:
                continue  # such a board is not determined with the lens: the plain answer stands
            return noise, 1.0
        worst = max(worst, _welch(found, mine, split.second))
    return noise, worst * tried


def _welch(found: Estimate, own: Indices, second: Mask) -> float:
    """Chance of a difference as large under one lens, from the scatter of each group."""
    if found.moved is None:
        return 1.0
    q, difference, moved = len(own), found.value[own], found.moved[:, own]
    parts, counts = [], []
    for mask in (second, ~second):
        count = int(mask.sum())
        parts.append((count - 1) / count * moved[mask].T @ moved[mask])
        counts.append(count)
    V = parts[0] + parts[1]
    if np.linalg.matrix_rank(V) < q:
        return 1.0
    shares = [float(np.trace(np.linalg.solve(V, part))) / q for part in parts]
    freedom = 1 / sum(share**2 / (count - 1) for share, count in zip(shares, counts))
    left = freedom - q + 1
    if left < 1:
        return 1.0
    statistic = float(difference @ np.linalg.solve(V, difference))
    return float(f_tail(q, left, statistic * left / (freedom * q)))


def _lenses_of(scores: ViewScores, split: Split, chance: float, *, in_height: bool) -> Groups | None:
    """The lens of each group, differing in scale and shift alone, and in height where that is what parts them."""
    camera = scores.camera
    columns, mine = kept_columns(scores, ZOOM, CENTRE, *([ASPECT] if in_height else []))
    found = estimate(scores, columns, only_in(scores, columns, mine, split.second), leave_out=True)
    if found is None:
        return None
    # (fx, fy, cx, cy) of both groups are linear in the unknowns.
    base = np.array([camera.parameters[n] for n in ("fx", "fy", "cx", "cy")])
    L = np.zeros((4, len(columns)))
    for row, name in enumerate(("fx", "fy", "cx", "cy")):
        at = np.flatnonzero(scores.parameter_indices == camera.model.index(name))
        L[row, at] = 1.0
    both = np.stack([L, L])
    both[1, [0, 1], mine[0]] += base[:2]
    both[1, [2, 3], [mine[1], mine[2]]] += 1.0
    if in_height:
        both[1, 1, mine[3]] += base[1]
    values = base + both @ found.value
    if found.moved is None:
        variance = np.einsum("gri,ij,grj->gr", both, found.covariance, both)
    else:
        n = len(scores)
        variance = (n - 1) / n * np.sum((both @ found.moved.T) ** 2, axis=-1)
    offset = found.value[mine]
    return Groups(split.second, chance, values, np.sqrt(variance), _apart(scores, offset), in_height)


def _told(scores: ViewScores, groups: Groups, names: Sequence[str], *, refuse: bool = True) -> OneCamera:
    """The check in words, and what the difference adds to the covariance where it is not refused."""
    stems = [name.rsplit("/", 1)[-1].rsplit("\\", 1)[-1] for name in names]
    said = []
    for g, mask in enumerate((~groups.second, groups.second)):
        members = [stem for stem, inside in zip(stems, mask) if inside]
        fx, fy, cx, cy = (f"{value:.1f} ± {sigma:.2g}" for value, sigma in zip(groups.values[g], groups.sigmas[g]))
        focal = f"fx {fx}, fy {fy}" if groups.in_height else f"fx {fx}"
        said.append(f"{_members(members)}: {focal}, cx {cx}, cy {cy} px")
    both = "; ".join(said)
    milli = 1e3 * groups.apart
    if refuse and groups.apart > _MATTERS and groups.chance < _CERTAIN:
        message = (
            f"two groups of views have lenses of their own, {milli:.2g} mrad apart: {both}. Two cameras, another zoom "
            "or focus, or images cropped, scaled or mirrored: calibrate them apart"
        )
        return OneCamera(Check(NAME, "fail", message, groups.chance))
    if groups.chance >= _BEYOND_SCATTER:
        message = f"two groups of views may differ by {milli:.2g} mrad, and the uncertainties hold it: {both}"
        return OneCamera(Check(NAME, "ok", message, groups.chance), _between(scores, groups))
    asked = (
        "Did the focus or the camera's temperature change? Calibrate them apart for more"
        if refuse
        else "Two cameras, another zoom or focus, or images cropped, scaled or mirrored? More views of one camera tell"
    )
    message = f"two groups of views differ by {milli:.2g} mrad, and the uncertainties hold it: {both}. {asked}"
    return OneCamera(Check(NAME, "warn", message, groups.chance), _between(scores, groups))


def _members(names: Sequence[str]) -> str:
    """The group's files: all where they are few, else the first and the last and how many."""
    if len(names) <= 3:
        return ", ".join(names)
    return f"{names[0]}, {names[1]} … {names[-1]} ({len(names)} views)"


def _between(scores: ViewScores, groups: Groups) -> Array:
    """Covariance (k, k) of the lens of a view drawn at random from both groups, about their mean."""
    camera = scores.camera
    offset = np.zeros(len(camera.values))
    difference = groups.values[1] - groups.values[0]
    for name, value in zip(("fx", "fy", "cx", "cy"), difference):
        offset[camera.model.index(name)] = value
    share = float(groups.second.mean())
    return share * (1 - share) * np.outer(offset, offset)


def _single(scores: ViewScores, lenses: OwnOfViews, names: Sequence[str]) -> OneCamera | None:
    """One view whose scale or shift stands out, beyond what the others scatter; None where there is none."""
    chances = np.column_stack([_odd_one_out(y, p) for y, p in zip(lenses.value.T, lenses.precision.T)])
    worst, kind = divmod(int(np.argmin(chances)), chances.shape[1])
    # A view that says little of its lens is far off by chance where its points err alike: what it says must stand out,
    # against the others, as much as where it says its lens to be. Views count, not points: those err alike.
    others = np.arange(len(scores)) != worst
    rest = max(float(lenses.squares[others].sum()) / max(float(lenses.freedom[others].sum()), 1.0), 1.0)
    q = float(lenses.freedom[worst])
    loud = float(f_tail(q, len(scores) - 2, float(lenses.squares[worst]) / q / rest)) * len(scores) if q > 0 else 1.0
    chance = max(float(chances[worst, kind]) * chances.size, loud)
    if chance > _CERTAIN:
        return None
    offset = np.zeros(3)
    offset[kind] = lenses.value[worst, kind]
    apart = _apart(scores, offset)
    if apart < _MATTERS:
        return None
    name = names[worst].rsplit("/", 1)[-1]
    sizes = (f"{100 * offset[0]:+.2g} % of scale", f"{offset[1]:+.2g} px to the right", f"{offset[2]:+.2g} px down")
    message = (
        f"{name} alone sees another lens, {sizes[kind]} against the other views ({1e3 * apart:.2g} mrad): another "
        f"zoom, focus or crop? Leave it out: --exclude {name}"
    )
    return OneCamera(Check(NAME, "warn", message, chance))


def _odd_one_out(y: Array, precision: Array) -> Array:
    """Chance of every value as far from the others, (n,).

    A value's variance is 1 / p_v of noise and what views scatter beyond it, which the others tell: tau^2 added to all
    alike (DerSimonian and Laird 1986), or all noise larger by one factor, whichever says more.
    """
    n = len(y)
    w = np.where(np.eye(n, dtype=bool), 0.0, precision)
    total = w.sum(axis=1)
    mean = w @ y / total
    spread = np.einsum("ij,ij->i", w, (y - mean[:, None]) ** 2)
    tau2 = np.maximum(spread - (n - 2), 0.0) / np.maximum(total - (w**2).sum(axis=1) / total, np.finfo(float).tiny)
    with np.errstate(divide="ignore"):
        noise = 1 / precision
        variance = np.maximum(tau2 + noise, np.maximum(spread / (n - 2), 1.0) * noise)
    return 2 * t_tail(n - 2, np.abs(y - mean) / np.sqrt(variance))


def _apart(scores: ViewScores, offset: Array) -> float:
    """How far a scale and a shift (3,), and a scale in height (4,), move the points seen, rms, over the focal length:
    radians."""
    fx, fy, cx, cy = (scores.camera.parameters[n] for n in ("fx", "fy", "cx", "cy"))
    scale = offset[0] + np.array([0.0, offset[3] if len(offset) > 3 else 0.0])
    moved = scale * (scores.pixels - [cx, cy]) + offset[1:3]
    return float(np.sqrt(np.mean(np.sum(moved**2, axis=1)))) / float(np.sqrt(fx * fy))
