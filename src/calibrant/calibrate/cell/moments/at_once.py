"""Do the views of each moment show one board, before cameras that stand still to each other?

Every moment gives where camera b stands to a (`sightings`), and some contradict the others (`pairs`). Where most agree,
the others are no pairs: b's view counts for its lens alone, and the view of a that it fits is named. Where they do not
agree, other pairings are tried, all views shifted by one, two or three. Cameras that moved in between are found by
`moved`, frames that were lost in a video by `gaps`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from calibrant.arrays import Array, Index, Mask
from calibrant.calibrate.cell.moments.gaps import gap_between
from calibrant.calibrate.cell.moments.late import led_back, scatter
from calibrant.calibrate.cell.moments.moved import Move, move_between
from calibrant.calibrate.cell.moments.pairs import (
    LEAST,
    NOISIER,
    PAIRED,
    PairErrors,
    PairKey,
    PairPoses,
    agreed_place,
    apart,
    off,
    pair_poses,
)
from calibrant.calibrate.cell.moments.reflected import BEHIND, reflections
from calibrant.calibrate.cell.moments.sightings import Common, relative, trees, view_of
from calibrant.calibrate.cell.problem.camera_role import CameraRole
from calibrant.calibrate.cell.problem.layout import Layout
from calibrant.calibrate.cell.problem.unused import with_unused
from calibrant.calibrate.cell.problem.views import HandEyeViews
from calibrant.calibrate.cell.starts.medoid import robust_mean
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.data import Check
from calibrant.errors import RefusedError
from calibrant.geometry import se3

MOVED = "cameras-moved"
AGREEING = 0.25
"""Pairs of a part that may contradict the others of it: single ones that do not belong."""
MOST_OF_IT = 0.5
"""Of the squares that pairs of a video contradict each other by: a step that takes less is none."""
SHIFTS = (1, -1, 2, -2, 3, -3)
_LISTED = 4
_TRIED = 30
"""Pairs from which on a list may be out of step."""


def seen_at_once(
    where: Layout,
    data: Sequence[HandEyeViews],
    roles: Mapping[str, CameraRole],
    times: Mapping[str, float],
    *,
    clocks: bool = False,
) -> tuple[tuple[HandEyeViews, ...], dict[str, CameraRole], tuple[Check, ...]]:
    """The data without views that belong to no moment, the lenses that they still count for, and what was found.

    times: seconds by moment, where a target was seen on the move (`swept`); clocks: how late cameras are is asked for.

    Raises: RefusedError where cameras moved against each other, or most of the pairs are none.
    """
    out, own, checks = list(data), dict(roles), list[Check]()
    by_time, known = bool(times), dict[PairKey, PairErrors]()
    if not any(p.handheld for p in where.pictures):
        return tuple(out), own, ()
    for pair in trees(where, data):
        # Lenses that are found in the whole alone put no board anywhere before it.
        if len(pair) < LEAST or any(own[n].weak is not None for n in (pair.a, pair.b) if n in own):
            continue
        lost = _lost(where, pair, out, own, times) if by_time else None
        if lost is not None:
            pair, check = lost
            checks.append(check)
            known.clear()  # of other lenses
        found = pair_poses(pair, out, own, times, known)
        D, wrong = _place(found, clocks=clocks)
        if wrong.any():
            known.clear()  # of other poses and lenses
            found = _other_branches(pair, found, D, out, own, times)
            D, wrong = _place(found, clocks=clocks)
        if clocks and wrong.any():  # pairs on the move contradict those that stand still
            moments = [out[s.list].ids[s.row] for s in pair.seen_b]
            led = replace(found, T_b=led_back(found.T_a, found.T_b, moments, times).T_b)
            if (still := apart(led, robust_mean(led.D))).sum() < wrong.sum():
                found, D, wrong = led, robust_mean(led.D), still
        move = _move(found, D)
        if move is not None and _parted(found, move):
            text = _moved_words(pair, found, move)
            if move.noisier(float(found.freedom.sum())) > NOISIER:
                raise RefusedError(f"{MOVED}: {text}")
            if by_time and move.z < MOST_OF_IT * move.total:
                continue  # what neighbours in time err alike by looks like a small step
            checks.append(Check(_name(MOVED, pair, where), "warn", text, 1e3 * float(np.linalg.norm(move.step[3:]))))
            continue
        if wrong.sum() > len(found) / 2:
            raise RefusedError(f"at-once: {_no_pairs(pair, found, int((~wrong).sum()), _middle(pair, out))}")
        if wrong.any():
            checks.append(_left_out(where, pair, found, D, wrong, out, own))
    return tuple(out), own, tuple(checks)


def _place(found: PairPoses, *, clocks: bool) -> tuple[Array, Mask]:
    """Where b stands to a by most pairs, and the pairs that contradict it. Half of them may be none: their mean is then
    between the places that pairs have. Of clocks that differ there is no one place: what moves has them on either side
    of their mean, where that of most would be one side's."""
    D = robust_mean(found.D)
    wrong = apart(found, D)
    if wrong.any() and not clocks:
        other = agreed_place(found)
        less = apart(found, other)
        if less.sum() <= wrong.sum():
            return other, less
    return D, wrong


def _lost(
    where: Layout,
    pair: Common,
    out: list[HandEyeViews],
    roles: dict[str, CameraRole],
    times: Mapping[str, float],
) -> tuple[Common, Check] | None:
    """Where one of two videos lost frames: the pairs before, and what is said; b's views after are out of the data."""
    found = pair_poses(pair, out, roles, {}, {})
    moments = [out[s.list].ids[s.row] for s in pair.seen_b]
    gap = gap_between(found.T_a, found.T_b, found.errors[0].mean(axis=0), moments, times)
    if gap is None:
        return None
    loser, other = (pair.b, pair.a) if gap.frames > 0 else (pair.a, pair.b)
    count = abs(gap.frames)
    text = (
        f"{loser} lost {count} frame{'' if count == 1 else 's'} between {found.names_a[gap.first - 1]} and "
        f"{found.names_a[gap.first]}, or {other} has as many twice: from there on their frames of one number were not "
        "taken at once"
    )
    rows = range(gap.first, len(found))
    _taken_out(where, pair, dict.fromkeys(rows, f"{text}; counts for the lens of {pair.b} alone"), out, roles)
    message = (
        f"{text}, and {len(rows)} of {len(found)} pairs are left out. Give the times of the pictures (--times), or "
        "calibrate the parts before and after apart"
    )
    kept = pair.only([k < gap.first for k in range(len(found))])
    return kept, Check(_name("at-once", pair, where), "warn", message, float(len(rows)))


def _taken_out(
    where: Layout, pair: Common, reasons: Mapping[int, str], out: list[HandEyeViews], roles: dict[str, CameraRole]
) -> None:
    """Takes b's views of these pairs out of the data; its lens keeps them."""
    for k, reason in reasons.items():
        s = pair.seen_b[k]
        mask = np.arange(len(out[s.list])) == s.row
        out[s.list] = out[s.list].without(mask, [reason] * len(mask))
    role = roles[pair.b]
    if role.prior is None and not role.exact:
        lists = [out[i] for i, p in enumerate(where.pictures) if p.camera == pair.b]
        roles[pair.b] = with_unused(role, lists)


def _move(found: PairPoses, D: Array) -> Move | None:
    return move_between(se3.local(np.broadcast_to(D, found.D.shape), found.D), *found.errors)


def _parted(found: PairPoses, move: Move) -> bool:
    """Whether the pairs before a move agree on a place, and those after it: pairs that are none agree on nothing."""
    parts = [found.take(rows, rows) for rows in (range(move.first), range(move.first, len(found)))]
    return all(apart(part, robust_mean(part.D)).sum() <= AGREEING * len(part) for part in parts)


def _other_branches(
    pair: Common,
    found: PairPoses,
    D: Array,
    out: list[HandEyeViews],
    roles: Mapping[str, CameraRole],
    times: Mapping[str, float],
) -> PairPoses:
    """The pairs with the second pose of a flat target where that agrees with the other pairs; the data have it then."""
    before, changed = list(out), False
    for k in np.flatnonzero(apart(found, D)).tolist():
        ways = []
        for name, s, T in ((pair.a, pair.seen_a[k], found.T_a[k]), (pair.b, pair.seen_b[k], found.T_b[k])):
            other = target_poses(roles[name].camera, [view_of(out, s)])
            ways.append([T, other.T_camera_target[0], other.doubles[0]])
        a, b = (np.array(w) for w in ways)
        tried = relative(np.repeat(a, 3, axis=0), np.tile(b, (3, 1, 1)))
        mm, deg = se3.deviation(np.broadcast_to(D, tried.shape), tried)
        i, j = divmod(int(np.argmin(mm + deg)), 3)
        for s, T in ((pair.seen_a[k], a[i]), (pair.seen_b[k], b[j])):
            B = out[s.list].B.copy()
            B[s.row] = T
            out[s.list] = replace(out[s.list], B=B)
            changed = True
    if not changed:
        return found
    turned = pair_poses(pair, out, roles, times, {})
    still = apart(turned, D)
    for k in np.flatnonzero(still & apart(found, D)).tolist():
        # Neither pose agrees: the views are as they were.
        for s in (pair.seen_a[k], pair.seen_b[k]):
            B = out[s.list].B.copy()
            B[s.row] = before[s.list].B[s.row]
            out[s.list] = replace(out[s.list], B=B)
    return pair_poses(pair, out, roles, times, {})


def _left_out(
    where: Layout,
    pair: Common,
    found: PairPoses,
    D: Array,
    wrong: Mask,
    out: list[HandEyeViews],
    roles: dict[str, CameraRole],
) -> Check:
    """Takes the views of b that belong to no moment out of the data, and says so."""
    rows = np.flatnonzero(wrong).tolist()
    mm, deg = se3.deviation(np.broadcast_to(D, found.D.shape), found.D)
    partners = {k: _partner(found, D, k) for k in rows}
    said, reasons = [], {}
    for k in rows:
        fits = partners[k]
        also = f"; it fits {found.names_a[fits]}" if fits is not None else ""
        text = (
            f"{found.names_a[k]} and {found.names_b[k]} do not show the board at one moment: by the other pairs it is "
            f"{mm[k]:.3g} mm and {deg[k]:.2g} deg elsewhere"
        )
        first = pair.seen_a[k]
        reasons[k] = f"{text}{also}; counts for the lens of {pair.b} alone"
        out[first.list] = out[first.list].noted({found.names_a[k]: text})
        said.append(f"{found.names_a[k]} and {found.names_b[k]}{also}")
    _taken_out(where, pair, reasons, out, roles)
    more = f" … ({len(said)})" if len(said) > _LISTED else ""
    shift = _common_shift(partners)
    from_then = shift is not None and len(rows) >= LEAST and rows == list(range(rows[0], len(found)))
    words = f": from {found.names_a[rows[0]]} on, {_late(pair, shift or 0)}" if from_then else ""
    message = (
        f"{len(rows)} of {len(found)} pairs do not show the board at one moment and are left out: "
        f"{'; '.join(said[:_LISTED])}{more}{words}. Was an image lost, or the board moved between the two shutters?"
    )
    return Check(_name("at-once", pair, where), "warn", message, float(len(rows)))


def _partner(found: PairPoses, D: Array, k: int) -> int | None:
    """The view of a that the view k of b fits best, None where it fits none."""
    n = len(found)
    tried = found.take(range(n), [k] * n)
    statistic = off(tried, D)
    best = int(np.argmin(statistic))
    return best if best != k and not apart(tried, D)[best] else None


def _common_shift(partners: Mapping[int, int | None]) -> int | None:
    """By how many moments b's views are late, where most of them are by as many, and none by others."""
    shifts = [k - other for k, other in partners.items() if other is not None]
    return shifts[0] if len(set(shifts)) == 1 and len(shifts) > len(partners) / 2 else None


def _late(pair: Common, shift: int) -> str:
    images = "image" if abs(shift) == 1 else "images"
    return f"{pair.b} is {abs(shift)} {images} {'late' if shift > 0 else 'early'}"


def _middle(pair: Common, data: Sequence[HandEyeViews]) -> Array:
    """The middle (3,) of the board, by all points that b saw of it."""
    points = np.concatenate([view_of(data, s).points for s in pair.seen_b])
    return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2)


def _reflected(pair: Common, found: PairPoses, agreeing: int, middle: Array) -> str | None:
    """Most pairs contradict each other: do they agree where one camera's pictures are mirrored, or seen from behind?"""
    n = len(found)
    ways = [
        (other.how, replace(found, T_b=other.T, C_b=other.C, L_b=other.L))
        for other in reflections(found.T_b, found.C_b, found.L_b, middle)
    ]
    how, best = min(ways, key=lambda way: scatter(way[1].D))
    D = robust_mean(best.D)
    fits = int((~apart(best, D)).sum())
    # Boards that face the cameras scatter little in any mirror: it must be far less than without one.
    if fits <= max(agreeing, n / 2) or scatter(best.D) > PAIRED * scatter(found.D):
        return None
    if how == BEHIND:
        return (
            f"{fits} of {n} do when one of them sees the board from behind: give its back as a board of its own "
            "that is fixed to the front (calibrant rig --board, --rigid), or leave such pairs out"
        )
    # Both eyes through one mirror look the same, but for the side that b stands at.
    who = pair.b if D[0, 3] > 0 else pair.a
    option = f"--mirror-{who}" if {pair.a, pair.b} == {"left", "right"} else f"--mirror {who}"
    return (
        f"{fits} of {n} do when the images of one camera are flipped left to right: {who} delivers mirror images, if "
        f"{pair.b} stands at the right of {pair.a}, else the other one. Give {option}"
    )


def _no_pairs(pair: Common, found: PairPoses, agreeing: int, middle: Array) -> str:
    """Most pairs contradict each other: is there a shift or a reflection under which they do not?"""
    n = len(found)
    text = f"only {agreeing} of {n} pairs agree on where {pair.b} stands to {pair.a}"
    best, most = None, agreeing
    for first, shift, a, b in _shifted(n):
        tried = found.take(a, b)
        fits = int((~apart(tried, robust_mean(tried.D))).sum())
        if fits > max(most, len(a) / 2):
            best, most = (first, shift, a, b), fits
    if best is not None:
        first, shift, a, b = best
        k = int(np.argmax(a != b))
        since = f"from {found.names_a[first]} on, " if first else ""
        return (
            f"{text}; {most} of {len(a)} do when {since}{_late(pair, shift)}: {found.names_a[a[k]]} goes with "
            f"{found.names_b[b[k]]}. The images are paired wrongly, shifted: leave out what has no partner, or name "
            "the files so that a pair has one name"
        )
    reflected = _reflected(pair, found, agreeing, middle)
    if reflected is not None:
        return f"{text}; {reflected}"
    return (
        f"{text}: the images are paired wrongly, the board moved between the two shutters, or the cameras are not "
        "fixed to each other"
    )


def _shifted(n: int) -> Iterator[tuple[int, int, Index, Index]]:
    """From which pair on b's views come how many moments late, and the pairs (a, b) as they then are; all first."""
    every = np.arange(n)
    for shift in SHIFTS:
        a = every[max(0, -shift) : n - max(0, shift)]
        if len(a) >= LEAST:
            yield 0, shift, a, a + shift
    for first in range(2, n - LEAST + 1, max(1, n // _TRIED)):
        for shift in (1, -1):
            a = every[(every < first) | ((every + shift >= first) & (every + shift < n))]
            yield first, shift, a, np.where(a < first, a, a + shift)


def _moved_words(pair: Common, found: PairPoses, move: Move) -> str:
    """Which camera moved, when, and by how much."""
    mm, deg = (float(v) for v in se3.mm_and_deg(move.step))
    return (
        f"{pair.b} moved against {pair.a} by {mm:.3g} mm and {deg:.2g} deg between {found.names_a[move.first - 1]} and "
        f"{found.names_a[move.first]}: calibrate the {move.first} pairs before and the {len(found) - move.first} after "
        "apart"
    )


def _name(name: str, pair: Common, where: Layout) -> str:
    return name if len(where.cameras) == 2 else f"{name}-{pair.b}"
