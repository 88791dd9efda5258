"""Poses of a board by its corners, made better by its depth: narrower along the line of sight, and one of two told.

A plane seen by weak perspective has two poses; its depths lie in one plane alone. With chi-square S_k of corners and
depth together, the odds of the first are exp((S_2 - S_1) / 2).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.pose.both_solutions import PoseSolution, ViewPose, weakest
from calibrant.calibrate.pose.estimate import SECOND, weakest_check
from calibrant.data import CalibrationResult, Check, TransformEstimate, View, ViewResult, as_transform, verdict_of
from calibrant.errors import RefusedError
from calibrant.optimize.chances import chi2_tail
from calibrant.perceive.board_depth.board import BoardPose, pose_with_depth
from calibrant.perceive.registered_depth.noise import DepthNoise
from calibrant.perceive.registered_depth.register import DepthRig

CONTRADICTS = 1e-3
"""Chance of corners and depth as far apart, all views counted, from which on they are said to contradict each other."""
TOLD = 99.0
"""Odds from which on one of two poses is the one: those of the default confidence of `calibrant pose`."""


@dataclass(frozen=True, eq=False)
class _Seen:
    """A view with depth: the pose by corners and depth, the other that still fits, whether depth ruled one out."""

    view: View
    best: BoardPose
    other: BoardPose | None
    told: bool


def with_depth(
    result: CalibrationResult, depths: Mapping[str, Array], rig: DepthRig, *, noise: DepthNoise
) -> CalibrationResult:
    """A result of kind "pose" with the depth of its views in it.

    Args: depths: of each view by its id, (h, w) metres, the depth camera's grid; noise: expected of the depth, what all
    depths share included. A view whose board has too little depth keeps the pose of its corners, and says so.
    Raises: InputError as `pose_with_depth`; RefusedError where no view's board has depth.
    """
    observations = result.observations
    views = {} if observations is None else {v.id: v for v in observations.views}
    alone = sum(not t.child.endswith(SECOND) for t in result.transforms) == 1
    transforms: list[TransformEstimate] = []
    rows = {v.id: v for v in result.views}
    seen, without = [], []
    for first in (t for t in result.transforms if not t.child.endswith(SECOND)):
        name = next(v.id for v in result.views if v.used) if alone else first.child.partition("@")[2]
        second = next((t for t in result.transforms if t.child == first.child + SECOND), None)
        try:
            found = _of_view(result, views[name], first, second, depths[name], rig, noise)
        except RefusedError as error:
            without.append(str(error))
            transforms += [first] if second is None else [first, second]
            continue
        seen.append(found)
        transforms.append(as_transform(first.parent, first.child, found.best.T_camera_target, found.best.covariance))
        if found.other is not None:
            other = found.other
            transforms.append(as_transform(first.parent, first.child + SECOND, other.T_camera_target, other.covariance))
        rows[name] = _row(rows[name], found)
    if not seen:
        raise RefusedError(f"no board has depth: {without[0]}")
    checks = _checks(result, seen, without)
    return replace(
        result, transforms=tuple(transforms), views=tuple(rows.values()), checks=checks, verdict=verdict_of(checks)
    )


def _of_view(
    result: CalibrationResult,
    view: View,
    first: TransformEstimate,
    second: TransformEstimate | None,
    depth: Array,
    rig: DepthRig,
    noise: DepthNoise,
) -> _Seen:
    both = []
    for t in (first, second):
        if t is None:
            continue
        covariance = np.zeros((6, 6)) if t.covariance is None else t.covariance
        found = pose_with_depth(view, t.matrix, covariance, depth, rig, noise=noise)
        off = np.sum(view.residuals(rig.colour, t.matrix) ** 2, axis=1)
        level = result.sigma_px or 1.0
        # Corners that do not belong are no witnesses of either pose.
        of_corners = float(np.sum(np.minimum(off / level**2, 25.0)))
        both.append((found.misfit + of_corners, found))
    both.sort(key=lambda f: f[0])
    odds = np.exp(min((both[1][0] - both[0][0]) / 2, 700.0)) if len(both) == 2 else np.inf
    told = len(both) == 2 and odds >= TOLD
    return _Seen(view, both[0][1], both[1][1] if len(both) == 2 and not told else None, told)


def _row(row: ViewResult, seen: _Seen) -> ViewResult:
    """The view's row with the new pose; what it said of two poses is answered."""
    words = [w for w in (row.reason or "").split("; ") if w and not w.startswith("two poses fit")]
    if seen.other is not None:
        words.append("two poses fit, with depth too")
    return replace(row, T_camera_target=seen.best.T_camera_target, reason="; ".join(words) or None)


def _checks(result: CalibrationResult, seen: Sequence[_Seen], without: Sequence[str]) -> tuple[Check, ...]:
    out = []
    for check in result.checks:
        if check.name == "weakest":
            check = weakest_check([_as_view_pose(s) for s in seen])
        elif check.name == "second-solution" and not without and _one_each(seen):
            check = Check(check.name, "ok", "the depth rules the mirrored pose out", check.value)
        out.append(check)
    out += [_gain(seen), _agreement(seen)]
    if without:
        words = f"{len(without)} of {len(without) + len(seen)} views are of the corners alone: {without[0]}"
        out.append(Check("depth-missing", "warn", words, float(len(without))))
    return tuple(out)


def _one_each(seen: Sequence[_Seen]) -> bool:
    """Whether the depth told one of two poses, and left no view with both."""
    return any(s.told for s in seen) and all(s.other is None for s in seen)


def _as_view_pose(seen: _Seen) -> ViewPose:
    pose = PoseSolution(seen.best.T_camera_target, seen.best.covariance, None, 0.0, 1.0)
    return ViewPose(seen.view, pose, None, weakest(pose, seen.view))


def _gain(seen: Sequence[_Seen]) -> Check:
    least = min(seen, key=lambda s: s.best.gain)
    before, after = (1e3 * float(np.sqrt(C[5, 5])) for C in (least.best.by_corners, least.best.covariance))
    text = (
        f"with {least.best.depths} depths on the board the sigma along the camera's axis is {after:.2g} mm, by corners "
        f"alone {before:.2g} mm"
    )
    if len(seen) > 1:
        text += f" (in {least.view.id}, where depth helps least)"
    share = 100 * least.best.scale_sigma
    if share > 0:
        text += f"; what all depths share is known to {share:.2g} % (1 sigma)"
    return Check("depth", "ok", text, least.best.gain)


def _agreement(seen: Sequence[_Seen]) -> Check:
    worst = max(seen, key=lambda s: s.best.apart)
    chance = min(1.0, len(seen) * chi2_tail(3, worst.best.apart))
    text = f"corners and depth agree (chi-square {worst.best.apart:.1f} of 3 in {worst.view.id})"
    if chance >= CONTRADICTS:
        return Check("depth-agreement", "ok", text, chance)
    text = (
        f"corners and depth contradict each other in {worst.view.id} (chi-square {worst.best.apart:.0f} of 3): is the "
        "target's size right, is it flat, is it the depth of this photo? calibrant verify depth finds a depth camera's "
        "scale; --sigma-scale says how well it is known"
    )
    return Check("depth-agreement", "warn", text, chance)
