"""Do the views of each moment show one board, before cameras that stand still to each other?

Every moment gives where camera b stands to a (`sightings`), D_m with C_m; d_m = local(D, D_m) from their robust mean. A
pair is apart where d_m^T C_m^-1 d_m is beyond chance, scaled by the median as in `consistency`, and would raise the
pair's own noise to `NOISIER` times: below that a common pose costs less than leaving the pair out. Where most pairs
agree, the others are no pairs: b's view counts for its lens alone, and the view of a that it fits is named. Where
they do not agree, other pairings are tried, all views shifted by one, two or three. Cameras that moved in between are
found by `moved`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array, Mask
from calibrant.calibrate.cell.moments.late import led_back, scatter
from calibrant.calibrate.cell.moments.moved import Move, move_between
from calibrant.calibrate.cell.moments.reflected import BEHIND, reflections
from calibrant.calibrate.cell.moments.sightings import (
    Common,
    Sighting,
    pose_errors,
    poses,
    relative,
    relative_maps,
    trees,
    view_of,
)
from calibrant.calibrate.cell.moments.swept import swept
from calibrant.calibrate.cell.problem.camera_role import CameraRole
from calibrant.calibrate.cell.problem.layout import Layout
from calibrant.calibrate.cell.problem.unused import with_unused
from calibrant.calibrate.cell.problem.views import HandEyeViews
from calibrant.calibrate.cell.starts.medoid import robust_mean
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.data import Check
from calibrant.errors import RefusedError
from calibrant.geometry import se3
from calibrant.optimize.chances import CHI2_6_LIMIT, CHI2_6_MEDIAN

NOISIER = 1.5
"""A pair's noise with the common place over its own, from which it is no pair: as for a camera among others."""
LEAST = 3
"""Pairs that can outvote one."""
MOVED = "cameras-moved"
AGREEING = 0.25
"""Pairs of a part that may contradict the others of it: single ones that do not belong."""
PAIRED = 0.25
"""Scatter of pairs over that of any views: views that have nothing to do with each other come to about one, half of
them that do to a quarter at most."""
SHIFTS = (1, -1, 2, -2, 3, -3)
_LISTED = 4
_Key = tuple[str, tuple[Sighting, ...]]
_Errors = tuple[Array, Array]
"""C and L of a camera's sightings (`sightings.pose_errors`)."""


@dataclass(frozen=True, eq=False)
class PairPoses:
    """T_a, T_b (n, 4, 4) of the moments of a pair with what they are off by (`sightings.pose_errors`): C_a, C_b
    (n, 6, 6), L_a, L_b (n, 6, p); freedom (n,): residuals of both views beyond their poses; names_a, names_b: the
    views' ids."""

    T_a: Array
    T_b: Array
    C_a: Array
    C_b: Array
    L_a: Array
    L_b: Array
    freedom: Array
    names_a: tuple[str, ...]
    names_b: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.T_a)

    @property
    def D(self) -> Array:
        """Where b stands to a, by each moment."""
        return relative(self.T_a, self.T_b)

    @property
    def errors(self) -> tuple[Array, Array]:
        """C (n, 6, 6) and L (n, 6, p) of each D."""
        M_a, M_b = relative_maps(self.T_a, self.T_b)
        C = M_a @ self.C_a @ np.swapaxes(M_a, 1, 2) + M_b @ self.C_b @ np.swapaxes(M_b, 1, 2)
        return C, np.concatenate([M_a @ self.L_a, M_b @ self.L_b], axis=2)

    def take(self, a: ArrayLike, b: ArrayLike) -> PairPoses:
        """Other pairs: views a of the first camera with views b of the second."""
        i, j = np.asarray(a, dtype=np.intp), np.asarray(b, dtype=np.intp)
        half = 0.5 * self.freedom
        return PairPoses(
            *(self.T_a[i], self.T_b[j], self.C_a[i], self.C_b[j], self.L_a[i], self.L_b[j]),
            half[i] + half[j],
            tuple(self.names_a[k] for k in i.tolist()),
            tuple(self.names_b[k] for k in j.tolist()),
        )


def pair_poses(
    pair: Common,
    data: Sequence[HandEyeViews],
    roles: Mapping[str, CameraRole],
    times: Mapping[str, float],
    known: dict[_Key, _Errors],
) -> PairPoses:
    """The poses of a pair's views, each with what its noise, its lens and, where times are known, its clock leave
    uncertain. known: what such sightings of these data are off by, as far as it was asked; most pairs have one camera.
    """
    T, C, L, views = [], [], [], []
    for name, seen in ((pair.a, pair.seen_a), (pair.b, pair.seen_b)):
        T.append(poses(data, seen))
        views.append([view_of(data, s) for s in seen])
        if (name, seen) not in known:
            sigma = np.array([data[s.list].sigma_px for s in seen])
            known[name, seen] = pose_errors(roles[name].camera, views[-1], T[-1], sigma)
        by_noise, by_lens = known[name, seen]
        C.append(by_noise)
        L.append(by_lens)
    by_jitter, late = swept([data[s.list].ids[s.row] for s in pair.seen_b], T[1], times)
    if by_jitter.any():
        C[1] = C[1] + by_jitter
        L[1] = np.concatenate([L[1], late[:, :, None]], axis=2)
    freedom = np.array([max(2 * len(a) + 2 * len(b) - 12, 1) for a, b in zip(*views)], dtype=np.float64)
    names_a, names_b = (tuple(v.id for v in seen) for seen in views)
    return PairPoses(T[0], T[1], C[0], C[1], L[0], L[1], freedom, names_a, names_b)


def off(found: PairPoses, D: Array) -> Array:
    """d^T C^-1 d (n,) of every pair against a common place."""
    own, (C, L) = found.D, found.errors
    d = se3.local(np.broadcast_to(D, own.shape), own)
    return np.einsum("ni,ni->n", d, np.linalg.solve(C + L @ np.swapaxes(L, 1, 2), d[..., None])[..., 0])


def apart(found: PairPoses, D: Array) -> Mask:
    """Pairs (n,) that contradict a common place D."""
    statistic = off(found, D)
    noisier = np.sqrt(1 + statistic / found.freedom) > NOISIER
    if not noisier.any():
        return noisier  # and nothing asks what the others say
    # What boards, lenses and clocks have in common moves all pairs; those that are none say nothing of it.
    telling = np.ones_like(noisier) if _are_pairs(found) else ~noisier
    scale = max(float(np.median(statistic[telling])) / CHI2_6_MEDIAN, 1.0) if telling.any() else 1.0
    return np.asarray((statistic / scale > CHI2_6_LIMIT) & noisier)


def _are_pairs(found: PairPoses) -> bool:
    """Whether the pairs agree far better than the same views would in any other order: then they are pairs, however
    little they agree."""
    n = len(found)
    if n < LEAST:
        return False
    mixed = found.take(range(n), np.roll(np.arange(n), n // 2))
    return scatter(found.D) < PAIRED * scatter(mixed.D)


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
    by_time, known = bool(times), dict[_Key, _Errors]()
    if not any(p.handheld for p in where.pictures):
        return tuple(out), own, ()
    for pair in trees(where, data):
        # Lenses that are found in the whole alone put no board anywhere before it.
        if len(pair) < LEAST or any(own[n].weak is not None for n in (pair.a, pair.b) if n in own):
            continue
        found = pair_poses(pair, out, own, times, known)
        D = robust_mean(found.D)
        if apart(found, D).any():
            known.clear()  # of other poses and lenses
            found = _other_branches(pair, found, D, out, own, times)
            D = robust_mean(found.D)
        wrong = apart(found, D)
        if clocks and wrong.any():  # pairs on the move contradict those that stand still
            moments = [out[s.list].ids[s.row] for s in pair.seen_b]
            led = replace(found, T_b=led_back(found.T_a, found.T_b, moments, times))
            if (still := apart(led, robust_mean(led.D))).sum() < wrong.sum():
                found, D, wrong = led, robust_mean(led.D), still
        move = _move(found, D)
        if move is not None and _parted(found, move):
            text = _moved_words(pair, found, move)
            if move.noisier(float(found.freedom.sum())) > NOISIER:
                raise RefusedError(f"{MOVED}: {text}")
            if by_time:
                continue  # what neighbours in time err alike by looks like a small step
            checks.append(Check(_name(MOVED, pair, where), "warn", text, 1e3 * float(np.linalg.norm(move.step[3:]))))
            continue
        if wrong.sum() > len(found) / 2:
            raise RefusedError(f"at-once: {_no_pairs(pair, found, int((~wrong).sum()), _middle(pair, out))}")
        if wrong.any():
            checks.append(_left_out(where, pair, found, D, wrong, out, own))
    return tuple(out), own, tuple(checks)


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
    said = []
    for k in rows:
        fits = partners[k]
        also = f"; it fits {found.names_a[fits]}" if fits is not None else ""
        text = (
            f"{found.names_a[k]} and {found.names_b[k]} do not show the board at one moment: by the other pairs it is "
            f"{mm[k]:.3g} mm and {deg[k]:.2g} deg elsewhere"
        )
        s, first = pair.seen_b[k], pair.seen_a[k]
        mask = np.arange(len(out[s.list])) == s.row
        reason = f"{text}{also}; counts for the lens of {pair.b} alone"
        out[s.list] = out[s.list].without(mask, [reason] * len(mask))
        out[first.list] = out[first.list].noted({found.names_a[k]: text})
        said.append(f"{found.names_a[k]} and {found.names_b[k]}{also}")
    role = roles[pair.b]
    if role.prior is None and not role.exact:
        lists = [out[i] for i, p in enumerate(where.pictures) if p.camera == pair.b]
        roles[pair.b] = with_unused(role, lists)
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
    for shift in SHIFTS:
        a = np.arange(max(0, -shift), n - max(0, shift))
        if len(a) < LEAST:
            continue
        tried = found.take(a, a + shift)
        fits = ~apart(tried, robust_mean(tried.D))
        if fits.sum() > max(agreeing, len(a) / 2):
            example = f"{found.names_a[a[0]]} goes with {found.names_b[a[0] + shift]}"
            return (
                f"{text}; {int(fits.sum())} of {len(a)} do when {_late(pair, shift)}: {example}. The images are paired "
                "wrongly, shifted: leave out what has no partner, or name the files so that a pair has one name"
            )
    reflected = _reflected(pair, found, agreeing, middle)
    if reflected is not None:
        return f"{text}; {reflected}"
    return (
        f"{text}: the images are paired wrongly, the board moved between the two shutters, or the cameras are not "
        "fixed to each other"
    )


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
