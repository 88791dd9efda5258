"""The closed-form start of a rig: cameras fixed to each other, and targets that are moved before them.

Every camera is calibrated alone. From the reference camera on, whatever is tied to what is known already by the most
moments is placed next, by the mean of what these moments say that agree:

    a camera that sees a target known by now  T_root_camera = T_root_carrier T_carrier_target T_camera_target^-1
    a target on a carrier, seen by one placed  T_carrier_target = T_root_carrier^-1 T_root_camera T_camera_target

Where a camera sees only targets of a carrier that no placed camera sees beside it, both are unknown, and the motion
that the carrier makes tells them, T_root_carrier X T_camera_target^-1 = Z: the problem of hand and eye.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.problem.layout import Frame, Layout
from calibrant.calibrate.cell.problem.problem import moments_by_hand
from calibrant.calibrate.cell.problem.views import HandEyeViews
from calibrant.calibrate.cell.starts.medoid import robust_mean
from calibrant.calibrate.solvers.registry import get_solver
from calibrant.errors import RefusedError
from calibrant.geometry import se3

Moment = tuple[str, str]
"""A carrier's frame, and the moment."""
LEAST_MOVED = 3
"""Poses that a hand-eye problem needs: two motions about different axes."""


@dataclass(frozen=True, eq=False)
class CameraPair:
    """Two cameras that saw a target, or targets fixed to each other, at the same moments, and their relative pose."""

    a: str
    b: str
    shared: int
    T_a_b: Array


@dataclass(frozen=True, eq=False)
class _Seen:
    """What a camera saw of one target: T_camera_target by carrier and moment."""

    camera: str
    carrier: str
    target: str
    poses: Mapping[Moment, Array]


@dataclass(eq=False)
class _Placed:
    """What is known so far, in the root: cameras; targets on their carrier; carriers by moment, and who saw them."""

    cameras: dict[str, Array]
    targets: dict[str, Array]
    carriers: dict[Moment, Array] = field(default_factory=dict)
    seen_by: dict[Moment, list[str]] = field(default_factory=dict)

    def learn(self, seen: Sequence[_Seen]) -> None:
        """Where carriers are by what placed cameras see of placed targets."""
        self.carriers.clear()
        self.seen_by.clear()
        for s in seen:
            if s.camera in self.cameras and s.target in self.targets:
                # One camera's word is start enough: they differ by less than a step of the refinement.
                new = [m for m in s.poses if m not in self.carriers]
                if new:
                    back, T = se3.inverse(self.targets[s.target]), np.stack([s.poses[m] for m in new])
                    self.carriers |= zip(new, self.cameras[s.camera] @ T @ back, strict=True)
                for moment in s.poses:
                    self.seen_by.setdefault(moment, []).append(s.camera)

    def shared(self, s: _Seen) -> list[Moment]:
        """Moments of s at which its carrier's place is known."""
        return [m for m in s.poses if m in self.carriers]


def most(moments: Sequence[Moment]) -> float:
    """What is tied by the most moments is placed next."""
    return len(moments)


def fewest(moments: Sequence[Moment]) -> float:
    """What is tied by the fewest moments, but more than single ones, is placed next: another tree through a rig."""
    return -len(moments) if len(moments) >= LEAST_MOVED else len(moments) - np.inf


def handheld_start(
    layout: Layout, data: Sequence[HandEyeViews], *, rank: Callable[[Sequence[Moment]], float] = most
) -> tuple[dict[Frame, Array], tuple[CameraPair, ...]]:
    """The cameras' places (4, 4) in the root, targets' on their carriers, the carriers' (m, 4, 4) by moment, and the
    pairs of cameras that led there.

    rank: of the moments that tie something, by which what is placed next is chosen.

    Raises: RefusedError naming the cameras, or the targets, that share no moment with the rest.
    """
    seen = _seen(layout, data)
    placed = _Placed({layout.root: np.eye(4)}, {s.carrier: np.eye(4) for s in seen})
    tree: list[CameraPair] = []
    while True:
        placed.learn(seen)
        open_ = [s for s in seen if (s.camera in placed.cameras) != (s.target in placed.targets)]
        best = max((s for s in open_ if placed.shared(s)), key=lambda s: rank(placed.shared(s)), default=None)
        if best is not None:
            _place(placed, best, [s for s in open_ if (s.camera, s.target) == (best.camera, best.target)], tree)
        elif not _placed_by_motion(placed, seen, tree):
            break
    _require_all(layout, placed, seen)
    transforms = {f: placed.cameras[f[1]] if f[0] == layout.root else placed.targets[f[1]] for f in layout.unknown}
    for root, carrier in layout.handheld:
        moments = moments_by_hand(layout, data, carrier)
        transforms[root, carrier] = np.stack([placed.carriers[carrier, m] for m in moments])
    return transforms, tuple(tree)


def _seen(layout: Layout, data: Sequence[HandEyeViews]) -> list[_Seen]:
    """By camera and target; a camera's lists of one target are one."""
    poses: dict[tuple[str, str, str], dict[Moment, Array]] = {}
    for p, d in zip(layout.pictures, data):
        key = (p.camera, layout.carrier(p), layout.target(p))
        poses.setdefault(key, {}).update({(key[1], m): T for m, T, use in zip(d.ids, d.B, d.use) if use})
    return [_Seen(*key, found) for key, found in poses.items()]


def _place(placed: _Placed, best: _Seen, same: Sequence[_Seen], tree: list[CameraPair]) -> None:
    """Place the camera or the target of what is tied best; a camera by all targets that say where it is."""
    if best.target in placed.targets:
        mine = [s for s in same if s.camera == best.camera]
        told = [(s, placed.shared(s)) for s in mine]
        T = [np.stack([placed.carriers[m] for m in moments]) @ placed.targets[s.target]
             @ se3.inverse(np.stack([s.poses[m] for m in moments])) for s, moments in told if moments]  # fmt: skip
        placed.cameras[best.camera] = robust_mean(np.concatenate(T))
        _note(placed, best.camera, [m for s in mine for m in placed.shared(s)], tree)
        return
    moments = placed.shared(best)
    carriers = np.stack([placed.carriers[m] for m in moments])
    found = se3.inverse(carriers) @ placed.cameras[best.camera] @ np.stack([best.poses[m] for m in moments])
    placed.targets[best.target] = robust_mean(found)


def _note(placed: _Placed, camera: str, moments: Sequence[Moment], tree: list[CameraPair]) -> None:
    """The camera's pair: with the placed one that shares the most of these moments."""
    others = [a for m in moments for a in placed.seen_by[m]]
    partner = max(dict.fromkeys(others), key=others.count)
    T = se3.inverse(placed.cameras[partner]) @ placed.cameras[camera]
    tree.append(CameraPair(partner, camera, len({m for m in moments if partner in placed.seen_by[m]}), T))


def _placed_by_motion(placed: _Placed, seen: Sequence[_Seen], tree: list[CameraPair]) -> bool:
    """Place a camera and the target that it sees by the motion of the carrier; False where no motion tells one."""
    open_ = [s for s in seen if s.camera not in placed.cameras and s.target not in placed.targets]
    for s in sorted(open_, key=lambda s: -len(placed.shared(s))):
        moments = placed.shared(s)
        if len(moments) < LEAST_MOVED:
            continue
        carriers, back = (np.stack(list(T)) for T in ((placed.carriers[m] for m in moments),
                                                      (se3.inverse(s.poses[m]) for m in moments)))  # fmt: skip
        try:
            found = get_solver("park").solve(carriers, back)
        except RefusedError:
            continue  # these moments move too little; another pair may move enough
        placed.targets[s.target], placed.cameras[s.camera] = found.X, found.Z
        _note(placed, s.camera, moments, tree)
        return True
    return False


def _require_all(layout: Layout, placed: _Placed, seen: Sequence[_Seen]) -> None:
    """Raises: RefusedError naming what is not tied to the rest."""
    apart = [c for c in layout.cameras if c not in placed.cameras]
    if apart:
        groups = _tied(apart, seen)
        asked = " and such in which ".join(
            f"{_most_seen(placed.cameras, seen)} and {_most_seen(group, seen)} both see the board" for group in groups
        )
        raise RefusedError(
            f"the rig falls apart: {', '.join(apart)} saw the target at no moment together with "
            f"{', '.join(placed.cameras)}; take pictures in which {asked}, or check that simultaneous views carry the "
            "same moment"
        )
    loose = [s.target for s in seen if s.target not in placed.targets]
    if loose:
        carrier = next(s.carrier for s in seen if s.target == loose[0])
        raise RefusedError(
            f"{', '.join(dict.fromkeys(loose))} was seen at no moment together with {carrier}, which it is fixed to; "
            "take pictures in which both are seen, or in which cameras see them at once while they turn"
        )


def _tied(cameras: Sequence[str], seen: Sequence[_Seen]) -> list[list[str]]:
    """The cameras in groups that moments tie."""
    groups: list[tuple[list[str], set[Moment]]] = []
    for camera in cameras:
        moments = {m for s in seen if s.camera == camera for m in s.poses}
        mine = [g for g in groups if g[1] & moments]
        joined = [c for g in mine for c in g[0]]
        groups = [g for g in groups if g not in mine]
        groups.append(([*joined, camera], moments.union(*(g[1] for g in mine))))
    return [group for group, _ in groups]


def _most_seen(cameras: Collection[str], seen: Sequence[_Seen]) -> str:
    """Of these cameras the one that saw targets most often."""
    return max(cameras, key=lambda c: sum(len(s.poses) for s in seen if s.camera == c))
