"""The data under examination: robot poses, target poses or views, and the operations that repairs are made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Index
from calibrant.calibrate.cell.boards.turned import with_boards
from calibrant.calibrate.cell.loop.noise import LoopNoise
from calibrant.calibrate.cell.loop.target_size import target_size
from calibrant.calibrate.cell.problem.views import (
    FEWEST_POINTS,
    MINIMUM_POINTS,
    HandEyeViews,
    from_observations,
    from_target_poses,
)
from calibrant.calibrate.cell.starts.robust import OUTLIER_P, RobustFit, log_misfit, robust_fit
from calibrant.calibrate.solvers.setup import Setup, get_setup
from calibrant.cameras import Camera
from calibrant.data import Missed, Observations, RobotPoses, View
from calibrant.diagnose.doctor.evidence.loop import Loop
from calibrant.geometry import se3
from calibrant.optimize.chances import f_tail

TAIL = 2.0
"""Index of the heaviest tail that squared noise is taken to have, that of Student's t with four degrees of freedom:
with a heavier one the squares had no variance, and a noise level estimated from them no meaning."""


@dataclass(frozen=True, eq=False)
class Case:
    """n robot poses matched with n target poses, in one setup.

    data: the matched poses, with the views behind them where there are images. observations and camera: what the views
    come from; camera_given: the camera was known before, not calibrated from these images. times (n,): seconds of each
    moment, where they are known. scale: what the target was enlarged by in repairs. pose_units:
    the unit of length that the file of poses was read in.
    """

    setup: Setup
    data: HandEyeViews
    observations: Observations | None = None
    camera: Camera | None = None
    camera_given: bool = False
    times: Array | None = None
    scale: float = 1.0
    pose_units: str = "m"

    def __len__(self) -> int:
        return len(self.data)

    @cached_property
    def index(self) -> Index:
        """Rows of the poses that are used."""
        return np.flatnonzero(self.data.use)

    @property
    def ids(self) -> tuple[str, ...]:
        """Names of the poses that are used."""
        return tuple(self.data.ids[i] for i in self.index)

    @cached_property
    def A(self) -> Array:
        """(m, 4, 4) of the normal form A_i X B_i = Z, of the poses used."""
        return self.setup.normal_form(self.data.T_base_gripper[self.index])

    @property
    def B(self) -> Array:
        """(m, 4, 4) T_camera_target of the poses used."""
        return self.data.B[self.index]

    @property
    def certainty(self) -> Array:
        """(m,) how many times less certain each target pose is than a typical one."""
        return self.data.certainty[self.index]

    @cached_property
    def robust(self) -> RobustFit:
        """X and Z of the views that agree."""
        return robust_fit(self.A, self.B, certainty=self.certainty)

    @cached_property
    def size(self) -> LoopNoise | None:
        """The loop with the target's scale free and its sources of noise told apart; None where nothing tells it.

        Views that another source of noise excuses count again: an image whose errors tilt the board is no wrong pose.
        """
        used = self._every(~self.robust.outlier)
        fit = self._size(used)
        if fit is None or used[self.index].all():
            return fit
        again = self._every(~self.robust.outlier | ~_beyond(fit))
        return fit if np.array_equal(again, used) else self._size(again)

    def _size(self, used: NDArray[np.bool_]) -> LoopNoise | None:
        return target_size(self.setup, self.data, self.robust.X, used=used, camera=self.camera)

    def _every(self, of_used: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(n,) of all rows from (m,) of the used ones."""
        out = np.zeros(len(self), dtype=bool)
        out[self.index] = of_used
        return out

    @cached_property
    def condemned(self) -> NDArray[np.bool_]:
        """(m,) of the poses used: those that agree with the others by no source of noise, at any size of the target.

        And besides they stand apart from all the others: no two views have noise of quite the same size.
        """
        out = self.robust.outlier if self.size is None else self.robust.outlier & ~self.size.used
        return stand_apart(out, self.robust.fit.statistic)

    @cached_property
    def loop(self) -> Loop:
        """The loop over all views used."""
        return loop_of(self.robust.fit.deviation)

    @cached_property
    def typical(self) -> float:
        """Square of the median loop, distance times angle: what a few wrong views do not move."""
        d = self.robust.fit.deviation
        return float(np.median(np.linalg.norm(d[:, :3], axis=1)) * np.median(np.linalg.norm(d[:, 3:], axis=1)))

    @cached_property
    def misfit(self) -> float:
        """Sum over the views of 3 ln distance + 3 ln angle: minus the log-likelihood of noise of unknown size."""
        return 3 * float(log_misfit(self.robust.fit.deviation).sum())

    @cached_property
    def points(self) -> Array | None:
        """All the target's points that any view shows, (p, 3) metres; None without images."""
        if self.data.views is None:
            return None
        return np.unique(np.round(np.concatenate([v.points for v in self.data.views]), 9), axis=0)

    def with_order(self, order: Index) -> Case:
        """Row i gets the robot pose of row order[i]."""
        return replace(self, data=replace(self.data, T_base_gripper=self.data.T_base_gripper[order]))

    def with_poses_larger(self, factor: float) -> Case:
        """The robot's positions times a factor: read in another unit."""
        T = self.data.T_base_gripper.copy()
        T[:, :3, 3] *= factor
        return replace(self, data=replace(self.data, T_base_gripper=T))

    def with_boards(self, rows: Sequence[int], F: Array) -> Case:
        """Target poses of `rows` become B F (F (4, 4) or (k, 4, 4)); their views get the points F^-1 p."""
        data = with_boards(self.data, rows, F)
        return replace(self, data=data, observations=self._observed(data.views))

    def without(self, rows: Sequence[int], reason: str) -> Case:
        """The same with these rows left out."""
        dropped = np.zeros(len(self), dtype=bool)
        dropped[list(rows)] = True
        return replace(self, data=self.data.without(dropped, [reason] * len(self)))

    def scaled(self, factor: float) -> Case:
        """The target `factor` times as large: its points and its distances from the camera."""
        B = self.data.B.copy()
        B[:, :3, 3] *= factor
        views = self.data.views
        if views is not None:
            views = tuple(replace(v, points=v.points * factor) for v in views)
        data = replace(self.data, B=B, views=views)
        return replace(self, data=data, observations=self._observed(views), scale=self.scale * factor)

    def with_branches(self, sides: Sequence[Array]) -> Case:
        """Of the two poses that a flat target has in a picture, the one that agrees with the robot."""
        return replace(self, data=self.data.with_branches(sides))

    def with_inverted_targets(self) -> Case:
        """Target poses given as T_target_camera."""
        return replace(self, data=replace(self.data, B=se3.inverse(self.data.B)))

    @property
    def poses(self) -> RobotPoses:
        """The robot poses that are used."""
        return RobotPoses(self.ids, self.data.T_base_gripper[self.index])

    def target(self) -> Observations | Array:
        """What `calibrate_hand_eye` takes beside the poses: observations of the views used, or target poses."""
        if self.observations is None or self.data.views is None:
            return self.B
        out = set(self.data.ids) - set(self.ids)
        rows = zip(self.data.views, self.data.reasons, self.data.use)
        left = [(v, r) for v, r, use in rows if not use and len(v)]
        missed = tuple(Missed(v.id, (r or "left out").removeprefix("left out: "), v.camera, v.file) for v, r in left)
        views = tuple(v for v in self.observations.views if v.moment not in out)
        return replace(self.observations, views=views, missed=(*self.observations.missed, *missed))

    def _observed(self, views: tuple[View, ...] | None) -> Observations | None:
        """The observations with these views in the place of those of the same id."""
        if self.observations is None or views is None:
            return self.observations
        new = {v.id: v for v in views}
        return replace(self.observations, views=tuple(new.get(v.id, v) for v in self.observations.views))


def case_of_poses(poses: RobotPoses, T_camera_target: Array, *, setup: str, times: Array | None = None) -> Case:
    """A case of measured target poses (n, 4, 4), metres. Raises: InputError when the numbers differ."""
    return Case(get_setup(setup), from_target_poses(poses, T_camera_target), times=times)


def case_of_views(
    poses: RobotPoses,
    observations: Observations,
    camera: Camera,
    *,
    setup: str,
    camera_given: bool = False,
    times: Array | None = None,
) -> Case:
    """A case of views whose moments carry the poses' ids. Raises: InputError as `from_observations`."""
    least = FEWEST_POINTS if camera_given else MINIMUM_POINTS
    data = from_observations(poses, observations, camera, least=least)
    # A view too weak to calibrate from still says whose pose it has; its deviation counts for what it is worth.
    data = replace(data, use=np.isfinite(data.certainty))
    return Case(get_setup(setup), data, observations, camera, camera_given, times)


def _beyond(fit: LoopNoise) -> NDArray[np.bool_]:
    """Views whose deviation none of the sources explains: F(6, freedom), all views counted."""
    p = f_tail(6, max(fit.freedom, 1.0), np.maximum(fit.statistic / 6, 0.0))
    return np.asarray(p * len(p) < OUTLIER_P)


def stand_apart(suspects: NDArray[np.bool_], statistic: Array) -> NDArray[np.bool_]:
    """The suspects (n,) that are farther off than a heavy tail puts them, by squared deviations (n,).

    A board seen from the front has a pose many times less certain than a tilted one, blur and a bent board spoil some
    views more than others: their noise is not of one size, and far views are its tail. Of a tail P(s > x) ~ x^-a the
    j-th largest exceeds the next r times with the chance r^(-a j) (Renyi, "On the theory of order statistics", 1953).
    """
    order = np.argsort(-statistic, kind="stable")
    leading = int(np.cumprod(suspects[order]).sum())  # suspects that only suspects exceed
    sizes = np.log(np.maximum(statistic[order], np.finfo(float).tiny))
    j = np.arange(1, min(leading, len(sizes) - 1) + 1)
    log_p = -TAIL * j * (sizes[j - 1] - sizes[j])
    far = j[log_p + np.log(max(len(j), 1)) < np.log(OUTLIER_P)]
    out = np.zeros(len(sizes), dtype=bool)
    out[order[: int(far[-1]) if len(far) else 0]] = True
    return out


def loop_of(deviation: Array) -> Loop:
    """rms of deviations (n, 6), rad and m, as mm and deg."""
    mm = 1e3 * np.sqrt(np.mean(np.sum(deviation[:, 3:] ** 2, axis=1)))
    return Loop(float(mm), float(np.rad2deg(np.sqrt(np.mean(np.sum(deviation[:, :3] ** 2, axis=1))))))
