"""The eye of a servo loop: pictures of a camera turned into features, with their depth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.cameras import Camera
from calibrant.data import CameraSource, Picture, View
from calibrant.detection.detection import Detection
from calibrant.detection.registry import detector_for
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.opencv import cv2
from calibrant.servoing.sight.features import Features, features_of
from calibrant.servoing.sight.interaction import point_rows
from calibrant.servoing.sight.mounting import Mounting
from calibrant.targets.target import Target

Depth = Literal["estimated", "measured", "wanted"]
DEPTHS: tuple[Depth, ...] = ("estimated", "measured", "wanted")
LEAST_FOR_POSE = 4
ITERATIONS = 20
NEAREST = 1e-3
"""Metres in front of the camera that points of a pose keep."""
PATCH = 2
"""Pixels to every side over which a measured depth is the median: holes and edges are single pixels."""


def finder(target: Target) -> Callable[[Picture], Detection]:
    """Finds a target in pictures. Raises: InputError for a kind without a detector."""
    detector = detector_for(target.kind)

    def find(picture: Picture) -> Detection:
        grey = np.asarray(cv2.cvtColor(picture.colour, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
        return detector.detect(grey, target)

    return find


@dataclass(frozen=True, eq=False)
class Model:
    """Points (n, 3) of a target in its frame, metres, by ids (n,)."""

    ids: NDArray[np.int64]
    points: Array

    @classmethod
    def target(cls, target: Target) -> Model:
        """Of a target of known size."""
        return cls(target.point_ids, target.points)

    def of(self, ids: NDArray[np.int64]) -> Array:
        """The points of these ids (k, 3)."""
        row = {int(label): i for i, label in enumerate(self.ids)}
        return self.points[[row[int(label)] for label in ids]]


@dataclass(frozen=True, eq=False)
class Eye:
    """camera: as it was calibrated; mounting; source: where its pictures come from; find: the features of a picture;
    model: the target's points, where they are known in metres; depth: "estimated" by the target's pose, "measured" by a
    depth camera of the same grid, or "wanted", as it was taught; sigma_px: noise where the detector says none."""

    camera: Camera
    mounting: Mounting
    source: CameraSource
    find: Callable[[Picture], Detection]
    model: Model | None = None
    depth: Depth = "estimated"
    sigma_px: float = 0.2

    def __post_init__(self) -> None:
        if self.depth not in DEPTHS:
            raise InputError(f"depth {self.depth!r}; expected {', '.join(DEPTHS)}")

    def look(self, before: Features | None = None) -> Features | str:
        """The features of the next picture, or why there are none. before: the last ones, from which the pose starts.

        Raises: DeviceError when the camera gives no picture.
        """
        picture = self.source.take()
        return self.seen(picture, before)

    def seen(self, picture: Picture, before: Features | None = None) -> Features | str:
        """The features of a picture, or why there are none."""
        if picture.size != self.camera.image_size:
            raise InputError(
                f"camera {self.source.name} takes pictures of {picture.size[0]}x{picture.size[1]} px, and is "
                f"calibrated for {self.camera.image_size[0]}x{self.camera.image_size[1]} px"
            )
        return self.told(self.find(picture), picture, before)

    def told(self, found: Detection, picture: Picture, before: Features | None = None) -> Features | str:
        """The features that a detector found in a picture, or why there are none."""
        if not found.found:
            return found.reason or "no target"
        sigma = found.sigma_px if found.sigma_px is not None else np.full(len(found.uv), self.sigma_px)
        T, points, depth = None, None, np.full(len(found.uv), np.nan)
        if self.model is not None:
            points = self.model.of(found.point_ids)
            if len(points) < LEAST_FOR_POSE:
                return f"{len(points)} points of the target, a pose needs {LEAST_FOR_POSE}"
            T = self._pose(picture.name, found, points, sigma, before)
            if T is None:
                return "the points that were found fit no pose of the target"
            depth = se3.apply(T, points)[:, 2]
        if self.depth == "measured":
            measured = depth_at(picture, found.uv)
            depth = np.where(np.isfinite(measured), measured, depth)
        if self.depth == "wanted":
            depth = np.full(len(found.uv), np.nan)
        return features_of(
            self.camera,
            found.point_ids,
            found.uv,
            sigma,
            depth,
            points=points,
            T_camera_target=T,
            time_s=picture.time_s,
        )

    def _pose(self, name: str, found: Detection, points: Array, sigma: Array, before: Features | None) -> Array | None:
        if before is not None and before.T_camera_target is not None:
            # From the last pose: of a plane's two poses it stays with the one that it had.
            tracked = pose_from(self.camera, points, found.uv, sigma, before.T_camera_target)
            if tracked is not None:
                return tracked
        try:
            view = View(name, points, found.uv, found.point_ids, sigma_px=sigma)
            return target_poses(self.camera, [view]).T_camera_target[0]
        except InputError:
            return None


def pose_from(camera: Camera, points: Array, uv: Array, sigma_px: Array, start: Array) -> Array | None:
    """T_camera_target (4, 4) of the least error in normalised coordinates, next to `start`; None where it goes astray.

    Gauss-Newton by the interaction matrix: xi = L+ (x - x(T)), T <- exp(-xi) T.
    """
    seen = features_of(camera, np.arange(len(uv)), uv, sigma_px, np.ones(len(uv)))
    blocks = np.linalg.inv(seen.slope) / sigma_px[:, None, None]
    T = start
    for _ in range(ITERATIONS):
        p = se3.apply(T, points)
        if np.any(p[:, 2] <= NEAREST):
            return None
        xy = p[:, :2] / p[:, 2:]
        rows = np.einsum("nij,njk->nik", blocks, point_rows(xy, p[:, 2]).reshape(-1, 2, 6)).reshape(-1, 6)
        error = np.einsum("nij,nj->ni", blocks, seen.xy - xy).ravel()
        step = np.linalg.lstsq(rows, error, rcond=None)[0]
        T = se3.exp(-step) @ T
        if np.abs(step).max() < 1e-9:
            return np.asarray(T)
    return None


def depth_at(picture: Picture, uv: Array) -> Array:
    """Measured depth (n,) at pixels (n, 2), metres; NaN where there is none within PATCH.

    Raises: InputError for a picture without depth, or with depth of another size than its colour.
    """
    if picture.depth is None:
        raise InputError(f"picture {picture.name} has no depth: use a depth camera, or --depth estimated")
    if picture.depth.shape != picture.colour.shape[:2]:
        raise InputError(
            f"picture {picture.name}: depth of {picture.depth.shape[1]}x{picture.depth.shape[0]} px beside colour of "
            f"{picture.size[0]}x{picture.size[1]} px; expected depth registered to the colour picture"
        )
    h, w = picture.depth.shape
    out = np.full(len(uv), np.nan)
    for i, (u, v) in enumerate(np.rint(uv).astype(int)):
        patch = picture.depth[max(v - PATCH, 0) : min(v + PATCH + 1, h), max(u - PATCH, 0) : min(u + PATCH + 1, w)]
        good = patch[np.isfinite(patch) & (patch > 0)]
        if len(good):
            out[i] = float(np.median(good))
    return out


def filled(seen: Features, wanted: Features) -> Features:
    """With the depth that was taught where none is known: errors of depth change the way, not where it ends."""
    known = np.isfinite(seen.depth) & (seen.depth > 0)
    if known.all():
        return seen
    row = {int(label): i for i, label in enumerate(wanted.ids)}
    taught = np.array([wanted.depth[row[int(k)]] if int(k) in row else wanted.middle_depth for k in seen.ids])
    return replace(seen, depth=np.where(known, seen.depth, taught))
