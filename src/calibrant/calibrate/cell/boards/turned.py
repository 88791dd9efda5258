"""Boards that look the same turned: their turns, and views numbered so that the robot's motion agrees with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.cell.boards.numbering import Numbering, find_numbering
from calibrant.calibrate.cell.problem.views import HandEyeViews
from calibrant.calibrate.solvers.setup import Setup
from calibrant.data import Check, Observations, View
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3

NAME = "board-numbering"
MAY_LOOK_THE_SAME = ("chessboard", "circles")
"""Kinds of targets without marks that say which end is which; others are never numbered from another end."""


@dataclass(frozen=True, eq=False)
class BoardTurns:
    """The turns after which a board looks the same: F (k, 4, 4), T_target_target of s equal turns, s = 0 .. k - 1."""

    spec: str
    F: Array

    @property
    def deg(self) -> int:
        """The smallest turn, degrees."""
        return 360 // len(self.F)


def board_turns(spec: str | None) -> BoardTurns | None:
    """The turns of the board of that spec; None for one that looks different from every side, or that is not known.

    F = (R_z, c - R_z c) about the middle c of its points. Raises: InputError for a spec that cannot be read.
    """
    if spec is None or spec.partition(":")[0] not in MAY_LOOK_THE_SAME:
        return None
    from calibrant.targets.registry import parse_target  # not needed for pose pairs

    target = parse_target(spec)
    smallest = getattr(target, "turns_unnoticed_deg", None)
    if smallest is None:
        return None
    middle = 0.5 * (target.points.min(axis=0) + target.points.max(axis=0))
    R = so3.exp(np.deg2rad(np.arange(0, 360, smallest))[:, None] * [0.0, 0.0, 1.0])
    return BoardTurns(spec, se3.make(R, middle - R @ middle))


@dataclass(frozen=True, eq=False)
class ViewsNumbered:
    """How n views are to be numbered, by the robot: the turns of their board, and the numbering of each."""

    turns: BoardTurns
    numbering: Numbering

    @property
    def rows(self) -> NDArray[np.intp]:
        """Rows of the views that get another numbering."""
        return np.flatnonzero(self.numbering.steps)

    @property
    def F(self) -> Array:
        """(r, 4, 4): the target poses of these rows become B F."""
        return self.turns.F[self.numbering.steps[self.rows]]

    def observations(self, given: Observations, ids: Sequence[str]) -> Observations:
        """The observations with their views numbered so; ids (n,): the views' names, row by row."""
        step = dict(zip(ids, self.numbering.steps.tolist()))
        rows = [i for i, v in enumerate(given.views) if step.get(v.id, 0)]
        F = self.turns.F[[step[given.views[i].id] for i in rows]]
        return replace(given, views=turned_views(given.views, rows, F))

    @property
    def check(self) -> Check:
        """What was done, or cannot be done, in words."""
        n, turned = len(self.numbering.steps), len(self.rows)
        same = f"{self.turns.spec} looks the same turned by {self.turns.deg} deg, so that each image numbers it anew"
        figures = f"{self.numbering.turned_deg:.2g} deg instead of {self.numbering.given_deg:.2g} deg"
        if self.numbering.verdict == "open":
            message = (
                f"{same}; as numbered, the views do not turn as the robot does, and more than one other numbering "
                f"would ({figures}): take more views, tilted in different directions, or keep the board within 45 deg "
                "of upright in the images"
            )
            return Check(NAME, "fail", message)
        message = (
            f"{same}; the robot's motion says which end is which: {turned} of {n} views were numbered again, and the "
            f"rotations agree to {figures}"
        )
        return Check(NAME, "ok", message, float(turned))


def numbered_by_robot(
    turns: BoardTurns, sides: Sequence[Array], B: Array, use: NDArray[np.bool_]
) -> ViewsNumbered | None:
    """How views are to be numbered; None where the numbering given stays.

    Args: sides, ways to read the robot's poses, each A (n, 4, 4) of the normal form; B (n, 4, 4) T_camera_target;
    use (n,) the views whose B is known.
    """
    found = find_numbering([A[use, :3, :3] for A in sides], B[use, :3, :3], len(turns.F))
    if found.verdict == "given":
        return None
    steps = np.zeros(len(B), dtype=np.intp)
    steps[use] = found.steps
    return ViewsNumbered(turns, replace(found, steps=steps))


def agreeing(
    setup: Setup, data: HandEyeViews, observations: Observations
) -> tuple[HandEyeViews, Observations, tuple[Check, ...]]:
    """Data and observations numbered as the robot's motion says, and the check that says so where any view changed.

    Raises: RefusedError where more than one numbering is possible, and not the one given.
    """
    turns = board_turns(observations.target)
    if turns is None:
        return data, observations, ()
    found = numbered_by_robot(turns, [setup.normal_form(data.T_base_gripper)], data.B, data.use)
    if found is None:
        return data, observations, ()
    check = found.check
    if check.status == "fail":
        raise RefusedError(f"{check.name}: {check.message}")
    ids = [v.id for v in data.views or ()]
    return (
        with_boards(data, found.rows, found.F),
        found.observations(observations, ids),
        (check,),
    )


def with_boards(data: HandEyeViews, rows: Sequence[int] | NDArray[np.intp], F: Array) -> HandEyeViews:
    """Target poses of `rows` become B F (F (4, 4) or (r, 4, 4)); their views get the points F^-1 p.

    With F = (R_F, f) the origin moves by R_B f: v <- v + omega x R_B f, and the covariance with it.
    """
    rows = np.asarray(rows, dtype=np.intp)
    B, covariance = data.B.copy(), data.covariance.copy()
    shift = np.einsum("rij,rj->ri", B[rows, :3, :3], np.broadcast_to(F, (len(rows), 4, 4))[:, :3, 3])
    M = np.tile(np.eye(6), (len(rows), 1, 1))
    M[:, 3:, :3] = -so3.hat(shift)
    covariance[rows] = M @ covariance[rows] @ np.swapaxes(M, 1, 2)
    B[rows] = B[rows] @ F
    views = None if data.views is None else turned_views(data.views, rows, F)
    return replace(data, B=B, covariance=covariance, views=views)


def turned_views(views: Sequence[View], rows: Sequence[int] | NDArray[np.intp], F: Array) -> tuple[View, ...]:
    """The views with the points of `rows` moved by F^-1 (F (4, 4) or (r, 4, 4)) and named as what lies there."""
    names = {_place(p): int(i) for v in views for p, i in zip(v.points, v.point_ids)}
    by_row = dict(zip(map(int, rows), np.broadcast_to(F, (len(rows), 4, 4))))
    return tuple(_turned(v, by_row[i], names) if i in by_row else v for i, v in enumerate(views))


def _place(point: Array) -> tuple[int, ...]:
    """A point in nanometres."""
    return tuple(int(x) for x in np.round(1e9 * point))


def _turned(view: View, F: Array, names: Mapping[tuple[int, ...], int]) -> View:
    points = np.round(se3.apply(se3.inverse(F), view.points), 12)
    labels = [names.get(_place(p), int(i)) for p, i in zip(points, view.point_ids)]
    return replace(view, points=points, point_ids=np.array(labels))
