"""Ways to part views in two groups that may have been taken by different lenses, and how many of each kind there are.

Three families, each with a third of the false alarms: what a person would ask first (names, every second view), cuts of
the order, and any parting at all that the views' own scores propose. The last could be any of 2^(n - 1), and pays so.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np

from calibrant.arrays import Array, Indices, Mask
from calibrant.calibrate.review.view_scores import (
    ASPECT,
    CENTRE,
    SINGULAR,
    ZOOM,
    OwnOfViews,
    ViewScores,
    estimate,
    kept_columns,
    only_in,
)

FEWEST = 3
"""Views of a group: with two, their scatter has one degree of freedom and proves nothing."""
FAMILIES = 3
_MOST_NAMES = 6
"""More name patterns than this are no groups but names."""
_MOST_CUTS = 4
"""Cuts of the order that are looked at closely: the ones that part the views most."""
_ROUNDS = 10


@dataclass(frozen=True, eq=False)
class Split:
    """A parting of the views: second (n,) is true for one group. tried: how many of its kind there are."""

    second: Mask
    tried: float
    kind: str


def named_splits(names: Sequence[str]) -> list[Split]:
    """By what names have beside their numbers (left01, right01; folders), each against the rest, and every second: of
    the order, and by their numbers, which tell it where views are missing."""
    n = len(names)
    patterns = [_pattern(name) for name in names]
    found = list(dict.fromkeys(patterns))
    masks = [np.arange(n) % 2 == 1]
    odd = [_last_digit(name) % 2 == 1 for name in names]
    if not np.array_equal(odd, masks[0]) and not np.array_equal(odd, ~masks[0]):
        masks.append(np.array(odd))
    if 2 <= len(found) <= _MOST_NAMES:
        parts = [np.array([p == pattern for p in patterns]) for pattern in found]
        masks += parts[1:] if len(parts) == 2 else parts
    masks = [m for m in masks if _large_enough(m)]
    return [Split(m, FAMILIES * len(masks), "named") for m in masks]


def _pattern(name: str) -> str:
    """A file's folder and name with its numbers blanked: what tells series apart."""
    path = PurePath(name)
    return f"{path.parent}/{re.sub(r'[0-9]+', '#', path.stem)}"


def _last_digit(name: str) -> int:
    """The last digit of a file's name, by which it is even or odd; 0 where it has none."""
    numbers = re.findall(r"[0-9]+", PurePath(name).stem)
    return int(numbers[-1][-1]) if numbers else 0


def _large_enough(second: Mask) -> bool:
    return FEWEST <= int(second.sum()) <= len(second) - FEWEST


def ordered_splits(scores: ViewScores, own: tuple[str, ...]) -> list[Split]:
    """Cuts of the order that part the views most."""
    n = len(scores)
    cuts = [np.arange(n) >= at for at in range(FEWEST, n - FEWEST + 1)]
    return [Split(m, FAMILIES * len(cuts), "order") for m in _strongest(scores, cuts, own)[:_MOST_CUTS]]


def clustered_splits(scores: ViewScores, own: tuple[str, ...], lenses: OwnOfViews) -> list[Split]:
    """The parting that the views' own scales, shifts and heights propose, each view moved to where it fits until none
    moves. Args: lenses, of the columns in the order of `CHOICES`."""
    columns = {ZOOM: [0], CENTRE: [1, 2], ASPECT: [3]}[own[0]]
    best: list[Mask] = []
    n = len(scores)
    for column in columns:
        rank = np.argsort(np.argsort(lenses.value[:, column]))
        cuts = [rank >= at for at in range(FEWEST, n - FEWEST + 1)]
        best += _strongest(scores, cuts, own)[:1]
    out = [_settled(scores, second, own) for second in best]
    return [Split(m, FAMILIES * 2.0 ** (n - 1), "any") for m in out if _large_enough(m)]


def _strongest(scores: ViewScores, masks: Sequence[Mask], own: tuple[str, ...]) -> list[Mask]:
    """The masks in the order of how much they explain."""
    columns, mine = kept_columns(scores, *own)
    squares = _explained(scores, columns, mine, np.array(masks, dtype=np.float64))
    return [masks[i] for i in np.argsort(squares)[::-1]]


def _explained(scores: ViewScores, columns: Indices, mine: Indices, masks: Array) -> Array:
    """value^T C^-1 value (m,) of columns of their own in the views of each mask (m, n), as `estimate` has it, for all
    masks at once; 0 where they are not determined."""
    both = scores.gram[:, columns][:, :, np.append(columns, -1)]
    summed = np.tile(both.sum(axis=0), (len(masks), 1, 1))
    rows = (masks @ both[:, mine].reshape(len(scores), -1)).reshape(len(masks), len(mine), -1)
    summed[:, mine] = rows
    summed[:, :, mine] = np.swapaxes(summed[:, mine][:, :, : len(columns)], 1, 2)
    return _determined_squares(summed[:, :, :-1], summed[:, :, -1], mine) / scores.sigma_px**2


def _determined_squares(A: Array, y: Array, chosen: Indices) -> Array:
    """y_r^T S^-1 y_r (m,) of the chosen unknowns, the others eliminated from A (m, k, k) and y (m, k); 0 where a
    direction of A is not determined."""
    d = np.einsum("mii->mi", A)
    told = np.all(d > 0, axis=1)
    scale = np.where(told[:, None], 1 / np.sqrt(np.where(d > 0, d, 1.0)), 1.0)
    scaled, right = A * scale[:, :, None] * scale[:, None, :], (y * scale)[:, :, None]
    told &= np.linalg.eigvalsh(scaled)[:, 0] >= SINGULAR
    scaled[~told] = np.eye(A.shape[1])
    inverse = np.linalg.inv(scaled)
    value = (inverse @ right)[:, chosen]
    own = inverse[:, chosen[:, None], chosen]
    return np.where(told, np.sum(value * np.linalg.solve(own, value), axis=(1, 2)), 0.0)


def _settled(scores: ViewScores, second: Mask, own: tuple[str, ...]) -> Mask:
    """The parting once every view is in the group whose lens leaves it the smaller residual."""
    columns, mine = kept_columns(scores, *own)
    gram = scores.gram[:, columns[:, None], columns]
    right = scores.gram[:, columns, -1]
    for _ in range(_ROUNDS):
        found = estimate(scores, columns, only_in(scores, columns, mine, second))
        if found is None or not _large_enough(second):
            return second
        with_own, without = found.value, found.value.copy()
        without[mine] = 0.0
        cost = [np.einsum("nij,i,j->n", gram, x, x) + 2 * right @ x for x in (without, with_own)]
        moved = cost[1] < cost[0]
        if np.array_equal(moved, second):
            break
        second = moved
    return second


def all_splits(n: int) -> list[Split]:
    """Every parting of a few views in two."""
    bits = np.arange(1, 2 ** (n - 1))
    return [Split((b >> np.arange(n)) % 2 == 1, float(len(bits)), "any") for b in bits]


CHOICES: tuple[tuple[str, ...], ...] = ((ZOOM,), (CENTRE,), (ASPECT,))
"""What two lenses may differ in, asked one after the other: together they would need more views."""
