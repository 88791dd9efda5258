"""What goes into a hand-eye calibration: poses of the robot matched with views or target poses, judged one by one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import Observations, RobotPoses, View
from calibrant.errors import InputError
from calibrant.geometry import se3

WEAK_LEAVE_OUT = 10**0.5
"""A view whose target pose is this many times less certain than the typical one carries a tenth of its information."""
WEAK_FLAG = 2.0
"""The same for a quarter of the information: used, and said."""
MINIMUM_POINTS = 6
"""Fewer points than 6 leave less than half of their coordinates to check the pose with."""
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
        B, covariance = self.B.copy(), self.covariance.copy()
        B[self.use], covariance[self.use] = found.T_camera_target, found.covariance
        return replace(self, B=B, covariance=covariance)


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
        name: f"unsharp or overexposed: its points are located to {sigma:.2g} px, others typically to {typical:.2g} px"
        for name, sigma in stated.items()
        if sigma > WEAK_FLAG * typical
    }


def from_observations(
    poses: RobotPoses, observations: Observations, camera: Camera, sigma_px: float | None = None
) -> HandEyeViews:
    """Views matched to poses by id, each with its target pose and how certain that is.

    sigma_px: noise per axis; by default what the typical view's residuals show.
    """
    from calibrant.calibrate.pose.target_poses import target_poses  # not needed for pose pairs

    _, matched = match_views(poses, observations)
    views = list(observations.views)
    enough = np.array([len(v) >= MINIMUM_POINTS for v in views])
    if not enough.any():
        raise InputError(f"no view has {MINIMUM_POINTS} points or more; nothing to calibrate from")
    found = target_poses(camera, [v for v, ok in zip(views, enough) if ok])
    n = len(views)
    B = np.tile(np.eye(4), (n, 1, 1))
    covariance = np.zeros((n, 6, 6))
    B[enough], covariance[enough] = found.T_camera_target, found.covariance
    if sigma_px is None:
        sigma_px = max(float(np.median(found.rms_px)) / np.sqrt(2), LEAST_SIGMA_PX)
    deviations = np.sqrt(np.einsum("nii->ni", found.covariance)) * sigma_px
    sigma_mm, sigma_deg = se3.mm_and_deg(deviations)
    ratios = np.maximum(sigma_deg / np.median(sigma_deg), sigma_mm / np.median(sigma_mm))
    certainty = np.full(n, np.inf)
    certainty[enough] = ratios
    use = np.ones(n, dtype=bool)
    reasons: list[str | None] = [None] * n
    typical_points = float(np.median([len(v) for v in views]))
    rows = np.cumsum(enough) - 1
    for i, view in enumerate(views):
        k = rows[i]
        if not enough[i]:
            use[i], reasons[i] = False, f"only {len(view)} points, {MINIMUM_POINTS} are needed"
        elif certainty[i] > WEAK_FLAG:
            text = (
                f"its {len(view)} points leave the target's position uncertain by {sigma_mm[k]:.2g} mm and "
                f"{sigma_deg[k]:.2g} deg (typical {np.median(sigma_mm):.2g} mm, {np.median(sigma_deg):.2g} deg)"
            )
            use[i] = certainty[i] <= WEAK_LEAVE_OUT
            reasons[i] = f"weak view: {text}" if use[i] else text
        elif len(view) < FEW_POINTS_SHARE * typical_points:
            reasons[i] = f"weak view: only {len(view)} points, the others have {typical_points:.0f} typically"
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
    )
