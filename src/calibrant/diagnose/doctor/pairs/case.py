"""Pairs of views as the doctor compares them: where the right camera stands to the left one, by each pair.

    D_m = T_left_target(m) T_right_target(m)^-1

is one place for cameras that are fixed to each other, whatever the board does. How far the D_m are from the place that
most agree on is the loop of a stereo pair; a fault in the data opens it, and what undoes the fault closes it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.calibrate.cell.boards.turned import board_turns
from calibrant.calibrate.cell.moments.numbering import which_turns
from calibrant.calibrate.cell.moments.pairs import LEAST, PairPoses, agreed_place, apart
from calibrant.calibrate.cell.moments.sightings import pose_errors
from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Observations, View
from calibrant.diagnose.doctor.evidence.loop import Loop
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3

FEWEST_POINTS = 8
"""A view of fewer points says little of where its camera stands."""


@dataclass(frozen=True, eq=False)
class Lens:
    """A camera as the views of it have it, and its pixel noise, px."""

    camera: Camera
    sigma_px: float


LensOf = Callable[[Observations, str], Lens]
"""The lens of a camera of these observations, by its name."""


@dataclass(frozen=True, eq=False)
class PairCase:
    """left, right: names; views of the moments both saw, in order; lenses by name; found: the poses of both."""

    observations: Observations
    left: str
    right: str
    seen: tuple[tuple[View, ...], tuple[View, ...]]
    lenses: tuple[Lens, Lens]
    found: PairPoses

    def __len__(self) -> int:
        return len(self.found)

    @cached_property
    def place(self) -> Array:
        """D (4, 4) that most pairs agree on."""
        return agreed_place(self.found)

    @cached_property
    def wrong(self) -> Mask:
        """Pairs (n,) that contradict it."""
        return apart(self.found, self.place)

    @cached_property
    def loop(self) -> Loop:
        """How far the pairs are from that place, rms over all."""
        return loop_of(self.found, self.place)

    @property
    def middle(self) -> Array:
        """The middle (3,) of the board, by all points that were seen of it."""
        points = np.concatenate([v.points for v in self.seen[1]])
        return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2)

    def names(self, k: int) -> tuple[str, str]:
        """What the two views of a pair are called."""
        return self.found.names_a[k], self.found.names_b[k]


def loop_of(found: PairPoses, place: Array) -> Loop:
    """How far pairs are from a place, rms over all."""
    mm, deg = se3.deviation(np.broadcast_to(place, found.D.shape), found.D)
    return Loop(float(np.sqrt(np.mean(mm**2))), float(np.sqrt(np.mean(deg**2))))


def pair_case(observations: Observations, before: PairCase | None = None, lens: LensOf | None = None) -> PairCase:
    """The pairs of two cameras' views, each camera calibrated from its own; before: as they were, whose lenses are kept
    where a camera has the same views; lens: who says a camera's lens, `lens_of` unless given.

    Raises: InputError for other than two cameras; RefusedError where they share too few moments, or a lens is unknown.
    """
    names = tuple(observations.image_sizes)
    if len(names) != 2:
        raise InputError(f"a pair has two cameras, the views are of {len(names)}: {', '.join(names)}")
    each = [{v.moment: v for v in observations.of_camera(name).views if len(v) >= FEWEST_POINTS} for name in names]
    both = [m for m in each[0] if m in each[1]]
    if len(both) < LEAST:
        raise RefusedError(
            f"{names[0]} and {names[1]} saw the board together in {len(both)} pictures; expected {LEAST} or more: the "
            "others tell nothing of how they belong together"
        )
    seen = tuple(each[0][m] for m in both), tuple(each[1][m] for m in both)
    asked = lens or lens_of
    left, right = (_kept_lens(before, observations, name) or asked(observations, name) for name in names)
    lenses = left, right
    return PairCase(observations, *names, seen, lenses, poses_of(seen, lenses, observations.target))


def _kept_lens(before: PairCase | None, observations: Observations, name: str) -> Lens | None:
    """The lens of a camera whose views are as they were."""
    if before is None or name not in (before.left, before.right):
        return None
    old, new = (o.of_camera(name).views for o in (before.observations, observations))
    same = len(old) == len(new) and all(
        len(a) == len(b) and np.array_equal(a.uv, b.uv) and np.array_equal(a.points, b.points) for a, b in zip(old, new)
    )
    return before.lenses[(before.left, before.right).index(name)] if same else None


def lens_of(observations: Observations, name: str, *, model: str = "brown") -> Lens:
    """A camera by its own views, also where these do not pass as a calibration. Raises: RefusedError without one."""
    try:
        result = calibrate_intrinsics(_alone(observations, name), model=model)
    except RefusedError as error:
        found = error.result
        if not isinstance(found, CalibrationResult) or not found.cameras:
            raise RefusedError(f"camera {name}: {error}") from error
        result = found
    return Lens(next(iter(result.cameras.values())), result.sigma_px or 1.0)


def lenses(known: Mapping[str, Camera], model: Mapping[str, str]) -> LensOf:
    """Lenses by name: as they are known, else of a model (brown where none is named) by the views."""

    def lens(observations: Observations, name: str) -> Lens:
        if name not in known:
            return lens_of(observations, name, model=model.get(name, "brown"))
        views, camera = _alone(observations, name).views, known[name]
        T = target_poses(camera, views).T_camera_target
        squares = sum(float(np.sum(v.residuals(camera, pose) ** 2)) for v, pose in zip(views, T))
        freedom = sum(2 * len(v) - 6 for v in views)
        return Lens(camera, float(np.sqrt(squares / freedom)) or 1.0)

    return lens


def _alone(observations: Observations, name: str) -> Observations:
    """The views of one camera that say where it stands."""
    mine = observations.of_camera(name)
    return replace(mine, views=tuple(v for v in mine.views if len(v) >= FEWEST_POINTS))


def poses_of(
    seen: tuple[Sequence[View], Sequence[View]], lenses: tuple[Lens, Lens], target: str | None = None
) -> PairPoses:
    """The poses of pairs of views, (n,) each, by their cameras, with what they are off by."""
    T = [target_poses(lens.camera, views).T_camera_target for views, lens in zip(seen, lenses)]
    turns = board_turns(target)
    if turns is not None:  # each picture numbers such a board anew
        steps = which_turns(T[0][:, :3, :3], T[1][:, :3, :3], turns.F)
        T[1] = T[1] @ se3.inverse(turns.F)[steps]
    (C_a, L_a), (C_b, L_b) = (
        pose_errors(lens.camera, views, poses, np.full(len(views), lens.sigma_px))
        for views, lens, poses in zip(seen, lenses, T)
    )
    freedom = np.array([max(2 * len(a) + 2 * len(b) - 12, 1) for a, b in zip(*seen)], dtype=np.float64)
    names = (tuple(v.id for v in views) for views in seen)
    return PairPoses(T[0], T[1], C_a, C_b, L_a, L_b, freedom, *names)
