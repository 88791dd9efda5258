"""Clouds of a wrist camera in simulated cells, each calibrated from its own pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibrant.arrays import Array
from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.tasks.listener import Listener
from calibrant.tasks.options.cell import CellOptions
from calibrant.tasks.verify.in_cell.pinpoint import FAST

if TYPE_CHECKING:
    from calibrant.verification.stitch.clouds import Pair

LOOKS = ((0.0, 0.0, 0.42), (0.10, 0.0, 0.36), (-0.08, 0.08, 0.38), (0.0, -0.10, 0.40))
"""Places of the wrist camera about the middle of the things, metres, each turned towards it."""
MIDDLE = (0.48, 0.0, 0.02)
SCALE = 2e-3
"""Of what a D435's own calibration errs by at this distance, relative."""


def stitch_series(options: CellOptions, *, tolerance_mm: float | None, listener: Listener) -> CalibrationResult:
    """The result of kind "stitch" over all seeds; a run a pair of pictures."""
    from calibrant.verification.stitch.result import stitch_result

    if options.view != "wrist":
        raise InputError(f"clouds of many poses are a hand camera's: --view wrist, not {options.view}")
    pairs: list[Pair] = []
    seeds: list[int] = []
    with listener.progress("Putting clouds together") as step:
        for i, seed in enumerate(options.runs):
            found = _in_one_cell(options, seed)
            pairs += found
            seeds += [seed] * len(found)
            step(i + 1, len(options.runs), f"seed {seed}")
    return stitch_result(pairs, tolerance_mm=tolerance_mm, seeds=seeds)


def _in_one_cell(options: CellOptions, seed: int) -> tuple[Pair, ...]:
    from calibrant.perceive.registered_depth.noise import DepthNoise
    from calibrant.perceive.registered_depth.planes import rays_of
    from calibrant.studies.cell_calibration import calibrate_cell_cameras
    from calibrant.verification.stitch.clouds import all_pairs, cloud_of
    from calibrant.verification.unchanged.robot_noise import robot_side

    with options.opened(seed) as cell:
        known = calibrate_cell_cameras(cell, ("wrist",))["wrist"].hand_eye
        side, source = robot_side(known, "wrist"), cell.cameras["wrist"]
        stated = source.stated
        if stated.depth is None or stated.T_colour_depth is None:
            raise InputError("the cell's wrist camera states no depth camera")
        rays, clouds = rays_of(stated.depth), []
        for k, place in enumerate(LOOKS):
            cell.robot.move_to(_towards(side.X, np.array(place), cell.robot.pose()), speed=FAST)
            picture = source.take()
            if picture.depth is None:
                raise InputError("the cell's wrist camera gives no depth")
            A = cell.robot.pose()
            T = A @ side.X @ stated.T_colour_depth
            clouds.append(cloud_of(f"seed {seed}, {k}", np.asarray(picture.depth), rays, T, A))
        p = stated.depth.parameters
        K = np.array([[p["fx"], 0, p["cx"]], [0, p["fy"], p["cy"]], [0, 0, 1.0]])
        noise = DepthNoise.stereo(focal_px=float(p["fx"]), baseline_m=0.05, pixels_per_sample=12.0, scale_sigma=SCALE)
        return all_pairs(clouds, K, side, noise)


def _towards(X: Array, place: Array, T_base_gripper: Array) -> Array:
    """T_base_gripper (4, 4) that puts a hand camera at a place about the middle, looking at it."""
    eye = np.array(MIDDLE) + place
    ahead = np.array(MIDDLE) - eye
    ahead = ahead / np.linalg.norm(ahead)
    x = (T_base_gripper @ X)[:3, 0]
    x = x - (x @ ahead) * ahead
    x = x / np.linalg.norm(x)
    R = np.column_stack([x, np.cross(ahead, x), ahead])
    return np.asarray(se3.make(R, eye) @ se3.inverse(X))
