"""Boards that look the same turned, seen by several cameras: numbered alike in all lists of pictures.

Each list is numbered by its robot's motion (`turned_boards`), from one end or the other as a whole. Lists that put one
target in the same frame must agree on that end: A_i X B_i F = Z F.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.boards.turned import (
    NAME,
    BoardTurns,
    agreeing,
    board_turns,
    turned_views,
    with_boards,
)
from calibrant.calibrate.cell.problem.layout import Frame, Layout, Pictures
from calibrant.calibrate.cell.problem.views import HandEyeViews
from calibrant.calibrate.cell.starts.seed import seed_of_all
from calibrant.calibrate.solvers.motion import motion_report
from calibrant.calibrate.solvers.setup import SETUPS, get_setup
from calibrant.data import Check
from calibrant.errors import RefusedError


def numbered_alike(
    where: Layout, data: Sequence[HandEyeViews]
) -> tuple[Layout, tuple[HandEyeViews, ...], tuple[Check, ...]]:
    """Pictures and views numbered as the robots say, and what was changed, as checks.

    Lists whose setup or motions say nothing stay as they are. Raises: RefusedError where several numberings are
    possible, and not the one given.
    """
    pictures, numbered = list(where.pictures), list(data)
    checks: list[Check] = []
    first: dict[Frame, Array] = {}
    for i, p in enumerate(where.pictures):
        turns = None if p.seen is None else board_turns(p.seen.target)
        if p.seen is None or turns is None or p.setup not in SETUPS:
            continue
        numbered[i], seen, said = agreeing(get_setup(p.setup), data[i], p.seen)
        pictures[i] = replace(p, observations=seen)
        checks += [replace(c, message=f"{where.prefix(i)}{c.message}") for c in said]
        Z = _target(p, numbered[i])
        if Z is None:
            continue
        end = _other_end(first.setdefault(where.constants(p)[1], Z), Z, turns)
        if end:
            numbered[i] = with_boards(numbered[i], range(len(numbered[i])), turns.F[end])
            views = turned_views(seen.views, range(len(seen.views)), turns.F[end])
            pictures[i] = replace(p, observations=replace(seen, views=views))
            message = f"{p.words}: all views are numbered from the end that the other cameras' views start at"
            checks.append(Check(NAME, "ok", message, float(len(views))))
    checks += _between_robots(first, checks)
    return replace(where, pictures=tuple(pictures)), tuple(numbered), tuple(checks)


def _target(p: Pictures, data: HandEyeViews) -> Array | None:
    """Rotation of Z as this list alone gives it; None where it gives none."""
    A, B = get_setup(p.setup).normal_form(data.T_base_gripper[data.use]), data.B[data.use]
    if len(A) < 3 or motion_report(A, B).degenerate:
        return None
    try:
        return np.asarray(seed_of_all(A, B).Z[:3, :3])
    except RefusedError:  # no closed form has an answer: the other lists say where this camera is
        return None


def _other_end(wanted: Array, R_Z: Array, turns: BoardTurns) -> int:
    """The turns that bring R_Z nearest to the rotation wanted."""
    return int(np.argmax(np.sum(wanted * (R_Z @ turns.F[:, :3, :3]), axis=(1, 2))))


def _between_robots(first: dict[Frame, Array], checks: Sequence[Check]) -> tuple[Check, ...]:
    """One target in the frames of two robots ties them, and no motion says whether by the same end."""
    targets = [target for _, target in first]
    shared = sorted({t for t in targets if targets.count(t) > 1})
    if not shared or not checks:
        return ()
    message = (
        f"{', '.join(shared)} looks the same turned and ties several robots: that both start at the same end is taken "
        "from the images alone; where the robots stand to each other may be wrong by that turn"
    )
    return (Check(NAME, "warn", message),)
