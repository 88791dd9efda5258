"""Two cameras before one moving board, at the level of points, with the truth behind what they saw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import Observations, View
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import grid, look_at_board, standard_camera
from calibrant.targets.registry import parse_target

SIDES = ("left", "right")


@dataclass(frozen=True, eq=False)
class StereoScene:
    """cameras by side; T_left_right (4, 4) and T_left_target (n, 4, 4), metres, true; points (p, 3) of the target;
    sigma_px: noise per axis of each side, by its name."""

    cameras: dict[str, Camera]
    T_left_right: Array
    T_left_target: Array
    points: Array
    sigma_px: dict[str, float]
    observations: Observations


def right_camera() -> Camera:
    """Another lens and another resolution than `standard_camera`: of a pair no two are alike."""
    parameters = {"fx": 880.3, "fy": 881.9, "cx": 492.7, "cy": 379.2}
    return Camera.create("brown", parameters | {"k1": -0.121, "k2": 0.052, "p1": -3e-4}, image_size=(1000, 780))


def standard_pair() -> Array:
    """T_left_right of two cameras 120 mm apart that look a little towards each other."""
    return se3.make(so3.exp([0.01, -0.06, 0.008]), [0.120, 0.002, -0.003])


def stereo_scene(
    seed: int,
    *,
    frames: int = 14,
    sigma_px: tuple[float, float] = (0.1, 0.1),
    cameras: tuple[Camera, Camera] | None = None,
    T_left_right: Array | None = None,
    distance: tuple[float, float] = (0.45, 0.9),
    partly: bool = True,
    target: str | None = None,
) -> StereoScene:
    """A pair that sees a board (9 x 6 points, or that of a spec) at `frames` moments, each wholly in the left image.

    partly: whether the right camera may miss part of the board, or all of it; else such moments are drawn again.
    """
    rng = np.random.default_rng(seed)
    left, right = cameras or (standard_camera(), right_camera())
    T_pair = standard_pair() if T_left_right is None else T_left_right
    points = grid(9, 6, 0.025) if target is None else parse_target(target).points
    poses: list[Array] = []
    while len(poses) < frames:
        (T,) = look_at_board(left, points, 1, rng=rng, distance=distance)
        if partly or _inside(right, se3.apply(se3.inverse(T_pair) @ T, points)).all():
            poses.append(T)
    T_left_target = np.stack(poses)
    views = []
    for m, T in enumerate(T_left_target):
        for side, camera, M, sigma in zip(SIDES, (left, right), (np.eye(4), se3.inverse(T_pair)), sigma_px):
            p = se3.apply(M @ T, points)
            seen = np.flatnonzero(_inside(camera, p))
            if len(seen) < 4:
                continue
            uv = camera.project(p[seen]) + sigma * rng.normal(size=(len(seen), 2))
            views.append(View(f"{side}{m:02d}", points[seen], uv, seen, side, moment=f"{m:02d}"))
    sizes = {side: camera.image_size for side, camera in zip(SIDES, (left, right))}
    return StereoScene(
        dict(zip(SIDES, (left, right))),
        T_pair,
        T_left_target,
        points,
        dict(zip(SIDES, sigma_px)),
        Observations(tuple(views), sizes, target),
    )


def _inside(camera: Camera, p: Array) -> Array:
    """Which points (n, 3) of the camera's frame lie in its image."""
    uv = camera.project(p)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.all((uv >= 0) & (uv <= np.array(camera.image_size) - 1), axis=1))
