"""Boards numbered from the wrong corner: half a turn about the normal, or a quarter where rows and columns are alike.

A detector that starts at another corner reports the pose B F instead of B, F a symmetry of the grid: a turn about the
board's normal through its middle. The middle is known from the points; where only poses are given it is found with it,
and the turn and the plane alone are evidence.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.starts.robust import log_misfit, noise_freedom
from calibrant.diagnose.doctor.evidence.case import Case, loop_of
from calibrant.diagnose.doctor.evidence.finding import Finding
from calibrant.diagnose.doctor.evidence.loop import Evidence
from calibrant.diagnose.doctor.evidence.significance import CONVINCING, confidence
from calibrant.geometry import se3, so3
from calibrant.optimize.chances import f_tail

SQUARE = 1e-3
"""Width and height of a grid that differ by less than this share are equal: then quarter turns are symmetries too."""
PLAUSIBLE = 1e-5
"""A turned board must fit so well that one right view in a hundred thousand fits worse."""


@dataclass(frozen=True, eq=False)
class Symmetry:
    """A turn of the board that a detector may confuse. F (4, 4), or None for a middle that is not known."""

    name: str
    words: str
    turn: float
    middle: Array | None

    def F(self, middle: Array) -> Array:
        """p -> R (p - c) + c."""
        R = so3.exp([0.0, 0.0, self.turn])
        return se3.make(R, middle - R @ middle)


def symmetries(points: Array | None) -> Iterator[Symmetry]:
    """The symmetries of a grid of points (p, 3), or those that any grid may have when the points are not known."""
    middle = None if points is None else 0.5 * (points.min(axis=0) + points.max(axis=0))
    yield Symmetry("board-flipped", "numbered from the opposite corner (turned by 180 deg)", np.pi, middle)
    if points is not None:
        width, height = np.ptp(points[:, :2], axis=0)
        if abs(width - height) > SQUARE * max(width, height):
            return
    yield Symmetry("board-rotated", "numbered from a neighbouring corner (turned by 90 deg)", np.pi / 2, middle)
    yield Symmetry("board-rotated", "numbered from a neighbouring corner (turned by -90 deg)", -np.pi / 2, middle)


def examine(case: Case) -> list[Finding]:
    """Which outlying views fit when their board is turned?"""
    out = np.flatnonzero(case.robust.outlier)
    if len(out) == 0:
        return []
    found = []
    for symmetry in symmetries(case.points):
        turned = [(int(k), F, p) for k in out for F, p in [_turn_of_view(case, int(k), symmetry)] if p > PLAUSIBLE]
        if turned:
            found.append(_boards_finding(case, symmetry, turned))
    return found


def _turn_of_view(case: Case, k: int, symmetry: Symmetry) -> tuple[Array, float]:
    """F of view k, and the chance that a right view fits worse than it does then."""
    fit, freedom = case.robust.fit, noise_freedom(case.robust.fit)
    sigma = fit.sigmas[k]
    A, B = case.A[k], case.B[k]
    if symmetry.middle is not None:
        F = symmetry.F(symmetry.middle)
        d = se3.local(case.robust.Z, A @ case.robust.X @ B @ F)
        return F, float(f_tail(6, freedom, np.sum((d / sigma) ** 2) / 6))
    # A X B F = Z with F = (R, f): f = t of (A X B)^-1 Z, of which only the part in the plane is free.
    wanted = se3.inverse(A @ case.robust.X @ B) @ case.robust.Z
    R = so3.exp([0.0, 0.0, symmetry.turn])
    F = se3.make(R, wanted[:3, 3] * [1, 1, 0])
    d = se3.local(case.robust.Z, A @ case.robust.X @ B @ F)
    return F, float(f_tail(4, freedom, np.sum((d / sigma) ** 2) / 4))


def _boards_finding(case: Case, symmetry: Symmetry, turned: list[tuple[int, Array, float]]) -> Finding:
    views = [k for k, _, _ in turned]
    F = np.stack([F for _, F, _ in turned])
    fit = case.robust.fit
    deviation = fit.deviation.copy()
    deviation[views] = se3.local(case.robust.Z, case.A[views] @ case.robust.X @ case.B[views] @ F)
    gain = 3 * float(log_misfit(fit.deviation[views]).sum() - log_misfit(deviation[views]).sum())
    p = min(1.0, float(case.robust.p_value[views].max()) * 3 * len(case.index))
    evidence = Evidence(case.loop, loop_of(deviation))
    names = tuple(case.ids[k] for k in views)
    rows = [int(case.index[k]) for k in views]
    return Finding(
        symmetry.name,
        "warn",
        f"{_listed_views(names)}: the board is {symmetry.words}; turned back, {evidence.text}",
        confidence(min(p, CONVINCING)),
        evidence,
        names,
        proposal="number its corners from the other end" if len(names) == 1 else "number their corners the other way",
        repair=partial(Case.with_boards, rows=rows, F=F),
        gain=gain,
    )


def _listed_views(names: tuple[str, ...]) -> str:
    return ", ".join(names) if len(names) <= 8 else f"{', '.join(names[:8])} and {len(names) - 8} more"
