"""A marker in several pictures of one camera that stands still: the mean of its corners, and its pose in the camera."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.pose.both_solutions import view_poses
from calibrant.cameras import Camera
from calibrant.data import View
from calibrant.data.devices import CameraSource, Picture
from calibrant.detection.registry import detector_for
from calibrant.errors import RefusedError
from calibrant.geometry import se3
from calibrant.opencv import cv2
from calibrant.targets.target import Target
from calibrant.verification.watch.placed import PlacedView, points_covariance

PICTURES = 5
"""Pictures a look: noise falls to less than half, and the rest is the same in all of them."""
SHARED_PX = 0.02
"""Of a corner, per axis, the same in every picture: what sampling and blur do to an edge at one place of the pixels."""
UPRIGHT = 0.5
"""Cosine above which a second solution's normal may be that of something that lies on a table."""


@dataclass(frozen=True, eq=False)
class Look:
    """What a camera saw: the target's points, the mean of the pictures that showed them all alike, and the pictures."""

    view: View
    pictures: tuple[Picture, ...]


def look(source: CameraSource, target: Target, *, pictures: int = PICTURES) -> Look:
    """The target as a camera that stands still sees it.

    Raises: RefusedError where no picture shows it, with the detector's reason; DeviceError when the camera is gone.
    """
    taken, seen, reason = [], [], ""
    for _ in range(pictures):
        picture = source.take()
        taken.append(picture)
        view = seen_in(picture, target)
        if isinstance(view, str):
            reason = view
        else:
            seen.append(view)
    if not seen:
        raise RefusedError(
            f"camera {source.name} does not see the target {target.spec} in {pictures} pictures: {reason}. Bring it "
            "into "
            "view, whole and lit, and look again; the robot has not moved"
        )
    return Look(mean_view(seen), tuple(taken))


def seen_in(picture: Picture, target: Target) -> View | str:
    """The target's points in a picture, or why there are none."""
    grey = np.asarray(cv2.cvtColor(picture.colour, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    found = detector_for(target.kind).detect(grey, target)
    if not found.found:
        return found.reason or "not found"
    row_of = {int(label): row for row, label in enumerate(target.point_ids)}
    rows = np.array([row_of[int(label)] for label in found.point_ids])
    return View(picture.name, target.points[rows], found.uv, found.point_ids, sigma_px=found.sigma_px)


def mean_view(views: list[View]) -> View:
    """The mean of pictures taken from one place, of those that show the most points; each point's noise falls with
    their number, down to what is the same in all."""
    most = max(views, key=len)
    same = [v for v in views if np.array_equal(v.point_ids, most.point_ids)]
    uv = np.stack([v.uv for v in same])
    stated = np.full(len(most), 0.1) if most.sigma_px is None else most.sigma_px
    scatter = float(np.sqrt(np.mean(uv.var(axis=0, ddof=1)))) if len(same) > 2 else 0.0
    own = np.maximum(stated, scatter) / np.sqrt(len(same))
    return replace(most, uv=uv.mean(axis=0), sigma_px=np.hypot(own, SHARED_PX), covariance_px=None)


def marker_pose(camera: Camera, view: View, R_base_camera: Array) -> PlacedView:
    """The pose of a marker that lies on a table, of a flat target's two solutions the one whose normal points up."""
    lens = replace(camera, covariance=None)
    given = 0.1 if view.sigma_px is None else float(1 / np.sqrt(np.mean(view.sigma_px**-2)))
    pose = view_poses(lens, [view], sigma_px=given).views[0]
    T = pose.best.T_camera_target
    if pose.other is not None:
        ups = [float(abs(R_base_camera @ s.T_camera_target[:3, 2])[2]) for s in (pose.best, pose.other)]
        if ups[1] > max(ups[0], UPRIGHT) and pose.other.probability > 1e-6:
            T = pose.other.T_camera_target
    sigma = np.full(len(pose.view), given) if pose.view.sigma_px is None else pose.view.sigma_px
    return PlacedView(pose.view, se3.check(T, name="T_camera_target"), points_covariance(lens, pose.view, T, sigma))
