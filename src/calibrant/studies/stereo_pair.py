"""The stereo part of `calibrant study methods`: two direct linear transforms beside a calibrated pair.

Two cameras see two boards at right angles. The lecture's way (slides 36 and 37) takes one view, 11 coefficients a
camera, and solves the overdetermined system of a point; the calibrated pair takes all views, lenses with distortion,
and the most likely point. Both then measure the same new points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.rig import calibrate_rig
from calibrant.calibrate.classical.dlt import dlt
from calibrant.calibrate.classical.stereo import stereo_points
from calibrant.cameras import Camera
from calibrant.data import Observations, View
from calibrant.errors import CalibrantError
from calibrant.geometry import se3, so3
from calibrant.perceive.stereo.eyes import eyes_of
from calibrant.perceive.stereo.points import points_from_matches
from calibrant.studies.scenes import IMAGE_SIZE, Conditions, lens_of, solid_case

T_LEFT_RIGHT = se3.make(so3.exp([0.0, -0.12, 0.0]), [0.15, 0.0, 0.0])
"""150 mm apart, turned towards each other: their axes meet 1.2 m ahead."""
DISTANCES = (0.4, 0.6, 0.8, 1.2, 2.0)
"""Metres; the boards stand 0.5 to 0.7 m away."""
POINTS = 60
SIDES = ("left", "right")
LEAST_NOISE_PX = 1e-3
"""What exact points are weighed by."""
_ASIDE = 0.25
"""Tangent of how far from the left camera's axis new points lie: both cameras see them from 0.4 m on."""


@dataclass(frozen=True)
class StereoRow:
    """A way to measure points: where it is from, and the median error in mm at each distance, or why there is none."""

    method: str
    source: str
    error_mm: tuple[float, ...] = ()
    refused: str | None = None


@dataclass(frozen=True)
class StereoComparison:
    """Both ways on the same new points, by distance (metres)."""

    distances: tuple[float, ...]
    rows: tuple[StereoRow, ...]


@dataclass(frozen=True, eq=False)
class _Scene:
    """Views of the boards by both cameras, the boards' true poses from the left one, new points and their pixels."""

    views: dict[str, tuple[View, ...]]
    T_left_target: Array
    new: list[Array]
    seen: list[Array]
    sigma_px: float


def compared_pairs(conditions: Conditions) -> StereoComparison:
    """Errors of points by two direct linear transforms and by a calibrated pair."""
    scene = _scene(conditions)
    return StereoComparison(
        DISTANCES,
        (
            _row("two DLTs, one view", "slides 36-37", scene, _by_dlt),
            _row("calibrated pair, all views", "least squares in pixels", scene, _by_pair),
        ),
    )


def _scene(conditions: Conditions) -> _Scene:
    middle = (np.array(IMAGE_SIZE, dtype=np.float64) - 1) / 2
    camera = lens_of(conditions.lens, centre=middle)
    case = solid_case(conditions)
    T = np.zeros((0, 4, 4)) if case.T_camera_target is None else case.T_camera_target
    rng = np.random.default_rng([conditions.seed, 36])

    def noisy(uv: Array) -> Array:
        return uv + rng.normal(0, conditions.noise_px, uv.shape) if conditions.noise_px else uv

    left = tuple(replace(v, camera="left", moment=v.id) for v in case.views)
    right = []
    for v, pose in zip(left, T):
        uv = noisy(camera.project(se3.apply(se3.inverse(T_LEFT_RIGHT) @ pose, v.points)))
        seen = np.isfinite(uv).all(axis=1) & np.all((uv >= 0) & (uv <= np.array(IMAGE_SIZE) - 1), axis=1)
        right.append(replace(v, id=f"right-{v.id}", uv=np.where(seen[:, None], uv, 0), camera="right").subset(seen))
    new = []
    for z in DISTANCES:
        across = rng.uniform(-_ASIDE, _ASIDE, (POINTS, 2)) * z
        new.append(np.column_stack([across[:, 0] + 0.05, across[:, 1], np.full(POINTS, z)]))
    seen_new = [noisy(_pixels(camera, X)) for X in new]
    return _Scene({"left": left, "right": tuple(right)}, T, new, seen_new, max(conditions.noise_px, LEAST_NOISE_PX))


def _pixels(camera: Camera, X: Array) -> Array:
    """Pixels (2, n, 2) of points in the left camera's frame."""
    return np.stack([camera.project(X), camera.project(se3.apply(se3.inverse(T_LEFT_RIGHT), X))])


def _row(method: str, source: str, scene: _Scene, run: Callable[[_Scene], Sequence[float]]) -> StereoRow:
    try:
        return StereoRow(method, source, tuple(float(v) for v in run(scene)))
    except CalibrantError as error:
        return StereoRow(method, source, refused=str(error).splitlines()[0])


def _by_dlt(scene: _Scene) -> list[float]:
    """Median over the views, each of which calibrates both cameras anew, and over the points."""
    errors: list[list[Array]] = [[] for _ in scene.new]
    for left, right, T in zip(scene.views["left"], scene.views["right"], scene.T_left_target):
        P = np.stack([dlt(v.points, v.uv) for v in (left, right)])
        for k, (X, uv) in enumerate(zip(scene.new, scene.seen)):
            found = se3.apply(T, stereo_points(P, uv))
            errors[k].append(np.linalg.norm(found - X, axis=1))
    return [1e3 * float(np.median(np.concatenate(e))) for e in errors]


def _by_pair(scene: _Scene) -> list[float]:
    """The pair from all views; points in the boards' frame, as two DLTs give them, by the pose of each view."""
    views = (*scene.views["left"], *scene.views["right"])
    result = calibrate_rig(Observations(views, dict.fromkeys(SIDES, IMAGE_SIZE)))
    eyes = eyes_of(result, SIDES)
    poses = {v.id: v.T_camera_target for v in result.views if v.used}
    errors: list[list[Array]] = [[] for _ in scene.new]
    for k, (X, uv) in enumerate(zip(scene.new, scene.seen)):
        found = points_from_matches(eyes, uv, sigma_px=scene.sigma_px).points
        for view, T in zip(scene.views["left"], scene.T_left_target):
            pose = poses.get(view.id)
            if pose is not None:
                errors[k].append(np.linalg.norm(se3.apply(T @ se3.inverse(pose), found) - X, axis=1))
    return [1e3 * float(np.median(np.concatenate(e))) for e in errors]
