"""Boards that look the same turned, numbered alike by all cameras that see them at one moment.

Each image numbers such a board by itself, from one end or the other. With the turns F_s of the board a moment gives

    D_m,s = T_a_target(m) F_s T_b_target(m)^-1,

of which one is where the cameras stand, at every moment the same: the D that most moments come nearest to, each by its
own s. Of several as good the one that turns the fewest. The end that a handheld board starts at means nothing
else, so that the second camera's views are numbered as the first one's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.cell.boards.turned import NAME, BoardTurns, board_turns, turned_views, with_boards
from calibrant.calibrate.cell.moments.sightings import Common, Sighting, poses, trees
from calibrant.calibrate.cell.problem.layout import Layout, Pictures
from calibrant.calibrate.cell.problem.views import HandEyeViews
from calibrant.data import Check
from calibrant.geometry import se3, so3
from calibrant.targets.registry import parse_target

AGREE = np.deg2rad(10.0)
"""A rotation by single views of small boards is off by a few degrees; a board turned unnoticed is off by 90 or 180."""


def numbered_at_once(
    where: Layout, data: Sequence[HandEyeViews]
) -> tuple[Layout, tuple[HandEyeViews, ...], tuple[Check, ...]]:
    """Handheld boards numbered alike by all cameras, and the checks that say what was changed."""
    if not any(p.handheld for p in where.pictures):
        return where, tuple(data), ()
    pictures, numbered, checks = list(where.pictures), list(data), list[Check]()
    for pair in trees(where, data):
        for spec in dict.fromkeys(_spec(where, s) for s in pair.seen_a):
            same = board_turns(spec)
            turns = same or negative_turns(spec)
            if turns is None:
                continue
            mine = pair.only([_spec(where, s) == spec for s in pair.seen_a])
            R_a, R_b = (poses(numbered, seen)[:, :3, :3] for seen in (mine.seen_a, mine.seen_b))
            steps = which_turns(R_a, R_b, turns.F)
            if not steps.any() or (same is None and 2 * np.count_nonzero(steps) <= len(mine)):
                continue  # a camera sees a negative in all its pictures
            # T_b F_s^-1 numbers the board as the other camera does.
            back = {s: turns.F[(len(turns.F) - k) % len(turns.F)] for s, k in zip(mine.seen_b, steps.tolist()) if k}
            for i in {s.list for s in back}:
                pictures[i], numbered[i] = _turned(
                    pictures[i], numbered[i], {s.row: F for s, F in back.items() if s.list == i}
                )
            checks.append(Check(NAME, "ok", _said(pair, turns, len(back), len(mine), negative=same is None), len(back)))
    return replace(where, pictures=tuple(pictures)), tuple(numbered), tuple(checks)


def _said(pair: Common, turns: BoardTurns, changed: int, of: int, *, negative: bool) -> str:
    if negative:
        return (
            f"{pair.b} sees a negative of {turns.spec}, light where it is dark to {pair.a}: its {changed} views of the "
            "same moments are numbered from the other end"
        )
    return (
        f"{turns.spec} looks the same turned by {turns.deg} deg, so that each image numbers it anew: of {pair.b}, "
        f"{changed} of {of} views were numbered again as {pair.a} numbers the board at that moment"
    )


def negative_turns(spec: str | None) -> BoardTurns | None:
    """The half turn of a chessboard whose colours say which end is which: in a negative, as a thermal camera may see
    it, they say the other. None for other boards, whose marks are not found in a negative unless it is asked for."""
    if spec is None or spec.partition(":")[0] != "chessboard":
        return None
    points = parse_target(spec).points
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    R = so3.exp([0.0, 0.0, np.pi])
    return BoardTurns(spec, np.stack([np.eye(4), se3.make(R, middle - R @ middle)]))


def _spec(where: Layout, s: Sighting) -> str | None:
    seen = where.pictures[s.list].seen
    return None if seen is None else seen.target


def _turned(p: Pictures, data: HandEyeViews, F: Mapping[int, Array]) -> tuple[Pictures, HandEyeViews]:
    """A list with the boards of some rows turned. Args: F (4, 4) by row of the data."""
    rows, turns = list(F), np.stack(list(F.values()))
    names = [v.id for v in data.views or ()]
    if p.seen is None:
        return p, with_boards(data, rows, turns)
    at = {v.id: k for k, v in enumerate(p.seen.views)}
    views = turned_views(p.seen.views, [at[names[row]] for row in rows], turns)
    return replace(p, observations=replace(p.seen, views=views)), with_boards(data, rows, turns)


def which_turns(R_a: Array, R_b: Array, F: Array) -> NDArray[np.intp]:
    """The turn s (n,) of every moment, by rotations (n, 3, 3) of T_a_target and T_b_target; F (k, 4, 4).

    As given (0) where no turn makes two moments agree, or none does better.
    """
    n, k = len(R_a), len(F)
    D = np.einsum("nij,sjk,nlk->nsil", R_a, F[:, :3, :3], R_b)
    flat = D.reshape(n * k, 9)
    cosine = (flat @ flat.T - 1) / 2
    angle = np.arccos(np.clip(cosine, -1, 1)).reshape(n * k, n, k)
    steps = np.argmin(angle, axis=2)
    near = np.sum(np.min(angle, axis=2) < AGREE, axis=1)
    changed = np.sum(steps != 0, axis=1)
    best = max(range(n * k), key=lambda c: (near[c], -changed[c]), default=None)
    if best is None or near[best] < 2 or near[best] <= _near_as_given(angle):
        return np.zeros(n, dtype=np.intp)
    fits = np.min(angle[best], axis=1) < AGREE
    return np.where(fits, steps[best], 0)


def _near_as_given(angle: Array) -> int:
    """How many moments agree, at best, as they are numbered."""
    k = angle.shape[2]
    return int(np.max(np.sum(angle[::k, :, 0] < AGREE, axis=1)))
