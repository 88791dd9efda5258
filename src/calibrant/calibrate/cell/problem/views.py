"""What goes into a hand-eye calibration: poses of the robot matched with views or target poses, judged one by one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.cell.problem.flips import right_branches
from calibrant.cameras import Camera
from calibrant.data import Observations, RobotPoses, View
from calibrant.errors import InputError
from calibrant.geometry import se3

if TYPE_CHECKING:
    from calibrant.calibrate.pose.target_poses import TargetPoses

WEAK_LEAVE_OUT = 10**0.5
"""A view whose target pose is this many times less certain than the typical one carries a tenth of its information."""
WEAK_FLAG = 2.0
"""The same for a quarter of the information: used, and said."""
MINIMUM_POINTS = 6
"""Fewer points than 6 leave less than half of their coordinates to check the pose with."""
FEWEST_POINTS = 4
"""With a camera that is known, the corners of a single tag: what two spare numbers do not check the loop does."""
BOTH_FIT = float(np.log(1e4))
"""A second pose of a flat target is in question where the pixels say less than 10,000 to 1 against it."""
LEAST_SIGMA_PX = 1e-3
"""Start of the pixel noise where the views fit exactly; the joint fit finds its level."""
FEW_POINTS_SHARE = 0.5
"""A view with less than half of the typical number of points is said, even where they pin its pose down well."""


@dataclass(frozen=True, eq=False)
class HandEyeViews:
    """n matched poses: ids, T_base_gripper, B = T_camera_target (n, 4, 4), and for images the views behind them.

    covariance (n, 6, 6): of B for unit pixel noise, zero without images.
    certainty (n,): how many times less certain each B is than the typical one; points (n,), 0 without images.
    sigma_px: pixel noise per axis, as the typical view shows it; 1 without images.
    doubles (n, 4, 4): the second pose of a flat target where the pixels hardly tell it from B, else B; None where
    there is none.
    use (n,): false for a view that is left out; reasons (n,): why, or what to know of it.
    """

    ids: tuple[str, ...]
    T_base_gripper: Array
    B: Array
    covariance: Array
    views: tuple[View, ...] | None
    certainty: Array
    sigma_px: float
    use: NDArray[np.bool_]
    reasons: tuple[str | None, ...]
    doubles: Array | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Ids of the views; without images, of the poses."""
        return self.ids if self.views is None else tuple(v.id for v in self.views)

    @property
    def missing(self) -> dict[str, str]:
        """Names of all views without a use, and why."""
        return {name: reason or "" for name, reason, use in zip(self.names, self.reasons, self.use) if not use}

    def __len__(self) -> int:
        return len(self.ids)

    def without(self, dropped: NDArray[np.bool_], reason: list[str | None]) -> HandEyeViews:
        """The same with more views left out, each with its reason."""
        reasons = tuple(new if d and new else old for old, d, new in zip(self.reasons, dropped, reason))
        return replace(self, use=self.use & ~dropped, reasons=reasons)

    def noted(self, remarks: Mapping[str, str]) -> HandEyeViews:
        """The same with remarks on views, by id, where nothing is said of them yet."""
        ids = [v.id for v in self.views or ()]
        return replace(self, reasons=tuple(r or remarks.get(i) for r, i in zip(self.reasons, ids)))

    def seen_by(self, camera: Camera) -> HandEyeViews:
        """The same with the target poses of the used views found again by another camera."""
        if self.views is None:
            return self
        from calibrant.calibrate.pose.target_poses import target_poses  # not needed for pose pairs

        found = target_poses(camera, [v for v, use in zip(self.views, self.use) if use])
        # Of the two poses of a flat target the one that was chosen before.
        other = np.sum((found.doubles - self.B[self.use])[:, :3, :3] ** 2, axis=(1, 2))
        first = np.sum((found.T_camera_target - self.B[self.use])[:, :3, :3] ** 2, axis=(1, 2))
        second = (other < first)[:, None, None]
        B, covariance = self.B.copy(), self.covariance.copy()
        B[self.use] = np.where(second, found.doubles, found.T_camera_target)
        covariance[self.use] = np.where(second, found.doubles_covariance, found.covariance)
        return replace(self, B=B, covariance=covariance)

    def with_branches(self, sides: Sequence[Array]) -> HandEyeViews:
        """The same with the pose of each view that agrees with the robot, where two fit its picture.

        sides: the ways to read the robot's poses, each A (n, 4, 4) of the normal form.
        """
        if self.doubles is None:
            return self
        use = self.use
        R = self.B[use, :3, :3], self.doubles[use, :3, :3]
        second = np.zeros(len(self), dtype=bool)
        second[use] = right_branches([A[use, :3, :3] for A in sides], *R)
        return replace(self, B=np.where(second[:, None, None], self.doubles, self.B), doubles=None)


def from_target_poses(poses: RobotPoses, T_camera_target: Array) -> HandEyeViews:
    """Pairs that were measured elsewhere. Raises: InputError when the counts differ."""
    if len(T_camera_target) != len(poses):
        raise InputError(
            f"{len(poses)} robot poses but {len(T_camera_target)} target poses; every robot pose needs its target pose"
        )
    n = len(poses)
    return HandEyeViews(
        ids=poses.ids,
        T_base_gripper=poses.T_base_gripper,
        B=T_camera_target,
        covariance=np.zeros((n, 6, 6)),
        views=None,
        certainty=np.ones(n),
        sigma_px=1.0,
        use=np.ones(n, dtype=bool),
        reasons=(None,) * n,
    )


def from_handheld(views: Sequence[View], T_camera_target: Array, sigma_px: float) -> HandEyeViews:
    """Views of a target that nobody reports the pose of, by their moments: where the lens (n, 4, 4) puts it.

    All are used: what a weak view does not tell, the others' views of its moment do.
    """
    nobody = RobotPoses.from_matrices(np.tile(np.eye(4), (len(views), 1, 1)))
    found = from_target_poses(nobody, T_camera_target)
    return replace(found, ids=tuple(v.moment for v in views), views=tuple(views), sigma_px=sigma_px)


def match_views(poses: RobotPoses, observations: Observations) -> tuple[list[int], list[int]]:
    """Indices of the views and of the robot poses that belong together, by id.

    A view without a pose is an error: its id is misspelt, or the file of poses is not of these images.
    """
    index = {name: i for i, name in enumerate(poses.ids)}
    moments = [view.moment for view in observations.views]
    lost = [m for m in moments if m not in index]
    if lost:
        raise InputError(
            f"no robot pose for {len(lost)} of {len(moments)} views, the first is {lost[0]!r}; poses are called "
            f"{', '.join(poses.ids[:4])} …; names must match, or leave these views out"
        )
    return list(range(len(moments))), [index[m] for m in moments]


def unsharp_views(views: Sequence[View]) -> dict[str, str]:
    """Views, by id, whose points the detector finds hard to locate, and the words for it.

    Their noise is WEAK_FLAG times the typical one (root mean square of the points' stated sigma).
    """
    stated = {v.id: float(np.sqrt(np.mean(v.sigma_px**2))) for v in views if v.sigma_px is not None}
    if not stated:
        return {}
    typical = float(np.median(list(stated.values())))
    return {
        name: f"unsharp, overexposed or seen at a steep angle: its points are located to {sigma:.2g} px, others "
        f"typically to {typical:.2g} px"
        for name, sigma in stated.items()
        if sigma > WEAK_FLAG * typical
    }


def from_observations(
    poses: RobotPoses,
    observations: Observations,
    camera: Camera,
    sigma_px: float | None = None,
    *,
    least: int = MINIMUM_POINTS,
) -> HandEyeViews:
    """Views matched to poses by id, each with its target pose and how certain that is.

    sigma_px: noise per axis; by default what the typical view's residuals show. least: points that a view needs,
    FEWEST_POINTS where the camera is known.
    """
    from calibrant.calibrate.pose.target_poses import determine_a_pose, target_poses  # not needed for pose pairs

    _, matched = match_views(poses, observations)
    views = list(observations.views)
    enough = np.array([len(v) >= least for v in views])
    if not enough.any():
        raise InputError(f"no view has {least} points or more; nothing to calibrate from")
    enough[enough] = determine_a_pose(camera, [v for v, ok in zip(views, enough) if ok])
    if not enough.any():
        raise InputError(
            "no view's points lie so that they determine a pose of the target: they are on a line, or not as the "
            "target has them; nothing to calibrate from"
        )
    found = target_poses(camera, [v for v, ok in zip(views, enough) if ok])
    n = len(views)
    B = np.tile(np.eye(4), (n, 1, 1))
    covariance = np.zeros((n, 6, 6))
    B[enough], covariance[enough] = found.T_camera_target, found.covariance
    counts = np.array([len(v) for v, ok in zip(views, enough) if ok])
    spare = np.maximum(2 * counts - 6, 1)
    if sigma_px is None:
        # Of few points the pose takes up most of the noise.
        few = 2 * counts / spare if np.median(counts) < MINIMUM_POINTS else 1.0
        sigma_px = max(float(np.median(found.rms_px * np.sqrt(few))) / np.sqrt(2), LEAST_SIGMA_PX)
    doubles = B.copy()
    open_ = _both_fit(found, counts, spare)
    doubles[np.flatnonzero(enough)[open_]] = found.doubles[open_]
    deviations = np.sqrt(np.einsum("nii->ni", found.covariance)) * sigma_px
    sigma_mm, sigma_deg = se3.mm_and_deg(deviations)
    ratios = np.maximum(sigma_deg / np.median(sigma_deg), sigma_mm / np.median(sigma_mm))
    certainty = np.full(n, np.inf)
    certainty[enough] = ratios
    use, reasons = _judged(views, certainty, sigma_mm, sigma_deg, least)
    return HandEyeViews(
        ids=tuple(v.moment for v in views),
        T_base_gripper=poses.T_base_gripper[matched],
        B=B,
        covariance=covariance,
        views=tuple(views),
        certainty=certainty,
        sigma_px=sigma_px,
        use=use,
        reasons=tuple(reasons),
        doubles=doubles if open_.any() else None,
    )


def _judged(
    views: Sequence[View], certainty: Array, sigma_mm: Array, sigma_deg: Array, least: int
) -> tuple[NDArray[np.bool_], list[str | None]]:
    """Which views (n,) are used, and what is said of those that are not or that are weak. certainty (n,): infinite with
    too few points; sigma_mm, sigma_deg: of the others."""
    use = np.ones(len(views), dtype=bool)
    reasons: list[str | None] = [None] * len(views)
    typical_points = float(np.median([len(v) for v in views]))
    rows = np.cumsum(np.isfinite(certainty)) - 1
    for i, view in enumerate(views):
        k = rows[i]
        if not np.isfinite(certainty[i]):
            few = len(view) < least
            words = (
                f"only {len(view)} points, {least} are needed" if few else f"its {len(view)} points determine no pose"
            )
            use[i], reasons[i] = False, words if few else f"{words}: on a line, or not as the target has them"
        elif certainty[i] > WEAK_FLAG:
            text = (
                f"its {len(view)} points leave the target's position uncertain by {sigma_mm[k]:.2g} mm and "
                f"{sigma_deg[k]:.2g} deg (typical {np.median(sigma_mm):.2g} mm, {np.median(sigma_deg):.2g} deg)"
            )
            use[i] = certainty[i] <= WEAK_LEAVE_OUT
            reasons[i] = f"weak view: {text}" if use[i] else text
        elif len(view) < FEW_POINTS_SHARE * typical_points:
            reasons[i] = f"weak view: only {len(view)} points, the others have {typical_points:.0f} typically"
    return use, reasons


def _both_fit(found: TargetPoses, counts: NDArray[np.intp], spare: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Views (m,) whose pixels do not tell their two poses apart: (S_2 - S_1) / (2 sigma^2), sigma that of all views."""
    squares = counts * found.rms_px**2
    variance = max(float(squares.sum() / spare.sum()), LEAST_SIGMA_PX**2)
    return np.asarray((counts * found.doubles_rms_px**2 - squares) / (2 * variance) < BOTH_FIT)
