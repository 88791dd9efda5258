"""Boards that look the same turned, numbered alike by all cameras that see them at one moment.

Each image numbers such a board by itself, from one end or the other. With the turns F_s of the board a moment gives

    D_m,s = T_a_target(m) F_s T_b_target(m)^-1,

of which one is where the cameras stand, at every moment the same: the D that most moments come nearest to, each by its
own s. Of several as good the one that turns the fewest. The end that a handheld board starts at means nothing
else, so that the second camera's views are numbered as the first one's. Where two cameras stand to each other is then
known, and with it how a third one numbers the moments that it shares with either, though with neither the most.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.cell.boards.turned import NAME, BoardTurns, board_turns, turned_views, with_boards
from calibrant.calibrate.cell.moments.sightings import Common, Moment, Sighting, common, poses, sightings, trees
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
    seen, placed = sightings(where, data), dict[str, Array]()
    for pair in trees(where, data):
        others = [_elsewhere(seen, pair, c) for c in placed if c != pair.a]
        for spec in dict.fromkeys(_spec(where, s) for s in pair.seen_a):
            same = board_turns(spec)
            turns = same or negative_turns(spec)
            if turns is None:
                continue
            mine = pair.only([_spec(where, s) == spec for s in pair.seen_a])
            R_a, R_b = (poses(numbered, seen)[:, :3, :3] for seen in (mine.seen_a, mine.seen_b))
            steps = which_turns(R_a, R_b, turns.F)
            if same is None and 2 * np.count_nonzero(steps) <= len(mine):
                continue  # a camera sees a negative in all its pictures
            back, of = _back(mine, steps, turns), len(mine)
            R_a_b = _turned_by(R_a, R_b, turns.F[steps, :3, :3])
            for other in others:
                more = other.only([_spec(where, s) == spec for s in other.seen_b])
                R_b_c = R_a_b.T @ placed[pair.a].T @ placed[other.a]
                R_c, R_b = (poses(numbered, seen)[:, :3, :3] for seen in (more.seen_a, more.seen_b))
                steps = nearest_turns(R_c, R_b, R_b_c, turns.F)
                back, of = back | _back(more, steps, turns), of + len(more)
            if not back:
                continue
            for i in {s.list for s in back}:
                pictures[i], numbered[i] = _turned(
                    pictures[i], numbered[i], {s.row: F for s, F in back.items() if s.list == i}
                )
            checks.append(Check(NAME, "ok", _said(pair, turns, len(back), of, negative=same is None), len(back)))
        R_a, R_b = (poses(numbered, found)[:, :3, :3] for found in (pair.seen_a, pair.seen_b))
        placed.setdefault(pair.a, np.eye(3))
        placed[pair.b] = placed[pair.a] @ _turned_by(R_a, R_b)
    return replace(where, pictures=tuple(pictures)), tuple(numbered), tuple(checks)


def _elsewhere(seen: Mapping[str, Mapping[Moment, Sighting]], pair: Common, camera: str) -> Common:
    """What b of the pair shares with another camera, beside the pair's moments."""
    there = common(seen, camera, pair.b)
    return there.only([m not in pair.moments for m in there.moments])


def _back(pair: Common, steps: NDArray[np.intp], turns: BoardTurns) -> dict[Sighting, Array]:
    """By b's sightings whose board is turned, what turns it back: T_b F_s^-1 numbers it as the other camera does."""
    k = len(turns.F)
    return {s: turns.F[(k - step) % k] for s, step in zip(pair.seen_b, steps.tolist()) if step}


def _turned_by(R_a: Array, R_b: Array, F: Array | None = None) -> Array:
    """R_a_b (3, 3): R_a F R_b^T of the moment that most others are near to."""
    D = R_a @ (np.swapaxes(R_b, 1, 2) if F is None else F @ np.swapaxes(R_b, 1, 2))
    cosine = (np.einsum("nij,mij->nm", D, D) - 1) / 2
    near = np.sum(cosine > np.cos(AGREE), axis=1)
    return np.asarray(D[np.argmax(near + cosine.mean(axis=1) / 2)])


def nearest_turns(R_a: Array, R_b: Array, R_b_a: Array, F: Array) -> NDArray[np.intp]:
    """The turn s (n,) of every moment by where b stands to a; as given (0) where none is near.

    Args: rotations (n, 3, 3) of T_a_target and T_b_target; R_b_a (3, 3); F (k, 4, 4).
    """
    turned = R_b[:, None] @ np.swapaxes(F[:, :3, :3], 1, 2)
    cosine = (np.einsum("nij,nsij->ns", R_b_a @ R_a, turned) - 1) / 2
    return np.where(cosine.max(axis=1, initial=-1.0) > np.cos(AGREE), np.argmax(cosine, axis=1), 0)


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
