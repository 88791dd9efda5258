"""Poses in the wrong order: shifted against the images, shifted from some view on, sorted as text, backwards.

Whatever X is, robot and camera turn by the same angle between two views. Each order is judged by that alone, over all
pairs of views; the best is then confirmed by the loop.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from calibrant.arrays import Array, Index
from calibrant.calibrate.cell.starts.robust import relative_angles
from calibrant.calibrate.solvers.relative import pair_indices
from calibrant.diagnose.doctor.evidence.case import Case
from calibrant.diagnose.doctor.evidence.finding import Finding
from calibrant.diagnose.doctor.evidence.loop import Evidence
from calibrant.diagnose.doctor.evidence.significance import CONVINCING, confidence, ratio_test
from calibrant.formats.poses.natural_order import natural_key

LEAST_VIEWS = 5
"""With four views the angles of a few pairs agree in a wrong order by chance."""
LEAST_RUN = 4
"""Shorter runs of shifted poses are exchanged poses, which is another finding."""
FARTHEST_SHIFT = 3
"""Shifts of the whole list by more places: a list that was matched by hand, not by a lost picture."""
MOST_IN_TABLE = 2000
"""Views whose angles are tabulated, all with all: 32 MB."""
LOOKED_AT = 100
"""Places of a long session from where the poses may be shifted that are looked at, and then all around the best: the
incongruence falls from far towards the right place."""
CONFIRMED = 3
"""Orders whose loop is looked at."""
RADIAN_FLOOR = 1e-4
"""Angles that agree better than 0.006 degrees agree by chance, whatever the order."""
BETTER = 2.0
"""The loop must become half as wide: an order that is right makes it ten and more times narrower."""


@dataclass(frozen=True, eq=False)
class Order:
    """Row i of the images belongs to row rows[i] of the poses; first: from where on that differs, 0 for the whole."""

    name: str
    words: str
    proposal: str
    rows: Index
    first: int = 0


def _whole_shifts(names: Sequence[str]) -> Iterator[Order]:
    """The whole list by up to FARTHEST_SHIFT places."""
    n = len(names)
    for shift in [s for k in range(1, FARTHEST_SHIFT + 1) for s in (k, -k) if k < n]:
        side = "earlier" if shift > 0 else "later"
        count = "one row" if abs(shift) == 1 else f"{abs(shift)} rows"
        yield Order(
            "poses-shifted",
            f"the poses stand {count} too {'late' if shift > 0 else 'early'}",
            f"pair every image with the pose {count} {'below' if shift > 0 else 'above'} its own ({side} than given)",
            np.roll(np.arange(n), -shift),
        )


def firsts(n: int) -> range:
    """Places from where a list of n poses may be shifted: all, or LOOKED_AT of them."""
    return range(2, n - LEAST_RUN + 1, max(1, n // LOOKED_AT))


def shifts_from(names: Sequence[str], first: int) -> Iterator[Order]:
    """The rows from `first` on by one place."""
    for shift in (1, -1):
        rows = np.arange(len(names))
        rows[first:] = np.roll(rows[first:], -shift)
        yield Order(
            "poses-shifted",
            f"from {names[first]} on the poses stand one row too {'late' if shift > 0 else 'early'}",
            f"pair {names[first]} and what follows with the pose one row {'below' if shift > 0 else 'above'}",
            rows,
            first,
        )


def orders(names: Sequence[str]) -> Iterator[Order]:
    """The wrong orders that occur, with what undoes them. Args: names of the images, n of them."""
    n = len(names)
    yield from _whole_shifts(names)
    for first in firsts(n):
        yield from shifts_from(names, first)
    text = sorted(range(n), key=lambda i: names[i])
    natural = sorted(range(n), key=lambda i: natural_key(names[i]))
    if text != natural:
        forward, backward = np.empty(n, dtype=np.intp), np.empty(n, dtype=np.intp)
        forward[text], backward[natural] = natural, text
        words = "the poses are in the order of names sorted as text (0, 1, 10, 11, 2 …)"
        yield Order("poses-sorted-as-text", words, "sort the names as numbers", forward)
        words = "the images are in the order of names sorted as text (0, 1, 10, 11, 2 …)"
        yield Order("poses-sorted-as-text", words, "sort the names as numbers", backward)
    yield Order("poses-backwards", "the poses are listed backwards", "turn the list over", np.arange(n)[::-1])


def incongruence(angles_a: Array, angles_b: Array) -> float:
    """Mean over pairs of ln |angle_A - angle_B|, (p,) each: lower is better, whatever the noise."""
    return float(np.mean(np.log(np.abs(angles_a - angles_b) + RADIAN_FLOOR)))


def congruent_orders(robot: Array, B: Array, used: Index, names: Sequence[str]) -> list[tuple[float, Order]]:
    """Orders in which robot (n, 4, 4) and camera (m, 4, 4, rows `used`) turn by more equal angles, best first.

    Each with its incongruence over the pairs that `pair_indices` chooses: all of them up to a hundred views.
    """
    i, j = pair_indices(len(used))
    of_robot, angles_b = _turn_angles(robot), _angles_of(B, i, j)
    now = incongruence(of_robot(used[i], used[j]), angles_b)

    def judged(tried: Iterable[Order]) -> list[tuple[float, Order]]:
        rows = ((order, order.rows[used]) for order in tried)
        values = ((incongruence(of_robot(r[i], r[j]), angles_b), order) for order, r in rows)
        return [(value, order) for value, order in values if value < now - np.log(1.2)]

    found = judged(orders(names))
    stride = firsts(len(names)).step
    if stride > 1:
        best = min((item for item in found if item[1].first), key=lambda item: item[0], default=None)
        if best is not None:
            first = best[1].first
            near = range(max(2, first - stride + 1), min(len(names) - LEAST_RUN, first + stride - 1) + 1)
            found += judged(order for k in near if k != first for order in shifts_from(names, k))
    found.sort(key=lambda item: item[0])
    return found


def _turn_angles(T: Array) -> Callable[[Index, Index], Array]:
    """Angles (p,) between the rotations of T (n, 4, 4) of rows i and j (p,), rad: looked up where a table fits."""
    if len(T) > MOST_IN_TABLE:
        return partial(_angles_of, T)
    table = relative_angles(T)
    return lambda i, j: table.reshape(-1)[i * len(T) + j]


def _angles_of(T: Array, i: Index, j: Index) -> Array:
    """Angles (p,) between the rotations of T (n, 4, 4) of rows i and j (p,), rad."""
    R = T[:, :3, :3].reshape(-1, 9)
    squares = 6.0 - 2.0 * np.einsum("pk,pk->p", R[i], R[j])  # |R_i - R_j|^2 of rotations
    return np.asarray(2 * np.arcsin(np.sqrt(np.clip(squares / 8, 0, 1))))


def examine(case: Case) -> list[Finding]:
    """Is there an order of the poses in which the loop closes far better?"""
    if len(case.index) < LEAST_VIEWS:
        return []
    candidates = congruent_orders(case.data.T_base_gripper, case.B, case.index, case.data.ids)
    best: tuple[Order, Case] | None = None
    for _, order in candidates[:CONFIRMED]:
        repaired = case.with_order(order.rows)
        if best is None or repaired.misfit < best[1].misfit:
            best = order, repaired
    if best is None:
        return []
    order, repaired = best
    before, after = case.typical, repaired.typical
    p = ratio_test(before, after, 3 * len(case.index) - 6, hypotheses=4 * len(case))
    gain = case.misfit - repaired.misfit
    if p > CONVINCING or before < BETTER**2 * after or gain <= 0:
        return []
    evidence = Evidence(case.loop, repaired.loop)
    return [
        Finding(
            order.name,
            "fail",
            f"{order.words}: paired rightly, {evidence.text}",
            confidence(p),
            evidence,
            proposal=order.proposal,
            repair=partial(Case.with_order, order=order.rows),
            gain=gain,
        )
    ]
