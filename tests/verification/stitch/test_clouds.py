"""Clouds of many poses: exact surfaces agree, a wrong mounting shows as far as it is predicted to, and is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.perceive.registered_depth.noise import DepthNoise
from calibrant.perceive.registered_depth.planes import rays_of
from calibrant.verification.stitch.clouds import Cloud, all_pairs, cloud_of
from calibrant.verification.stitch.result import stitch_result
from calibrant.verification.unchanged.robot_noise import RobotSide

CAMERA = Camera.create("pinhole", {"fx": 190.0, "fy": 190.0, "cx": 79.5, "cy": 59.5}, image_size=(160, 120))
K = np.array([[190.0, 0, 79.5], [0, 190.0, 59.5], [0, 0, 1]])
NOISE = DepthNoise.stereo(focal_px=190.0, baseline_m=0.1, disparity_px=0.02)
X = se3.make(so3.exp([0, 0, 0.3]), [0.05, -0.03, 0.06])
PLANES = (
    (np.array([0.0, 0.0, 1.0]), 0.0),
    (np.array([0.0, np.sin(0.6), np.cos(0.6)]), 0.05),
    (np.array([np.sin(0.7), 0, np.cos(0.7)]), 0.06),
)
"""Normals and distances of a table and two slopes on it: together they tell all three directions."""


def side(C: Array) -> RobotSide:
    return RobotSide(True, X, np.eye(4), np.pad(C, ((0, 10), (0, 10))), 1e-6, 1e-6, 0.0)


def gripper(k: int) -> Array:
    turn = so3.exp([0, 0, 1.3 * k]) @ so3.exp([np.pi, 0, 0]) @ so3.exp([0.25 * np.cos(2 * k), 0.25 * np.sin(2 * k), 0])
    T = se3.make(turn, np.zeros(3)) @ X
    return se3.make(np.eye(3), np.array([0.0, 0.0, 0.02]) - 0.45 * T[:3, 2]) @ T @ se3.inverse(X)


def depth(T_base_camera: Array, rng: np.random.Generator) -> Array:
    """The upper surface of all planes along every ray, with the noise of a stereo camera."""
    rays = rays_of(CAMERA) @ T_base_camera[:3, :3].T
    eye = T_base_camera[:3, 3]
    with np.errstate(divide="ignore"):
        ways = np.stack([(d - n @ eye) / (rays @ n) for n, d in PLANES])
    ways[ways <= 0] = np.inf
    z = ways.min(axis=0)
    return np.asarray(1 / (1 / z + NOISE.inverse_sigma * rng.normal(size=z.shape)))


def clouds(D: Array, rng: np.random.Generator, count: int = 4) -> list[Cloud]:
    """Pictures by a camera that sits at X D, put together with X."""
    rays, out = rays_of(CAMERA), []
    for k in range(count):
        A = gripper(k)
        out.append(cloud_of(f"{k}", depth(A @ X @ D, rng), rays, A @ X, A))
    return out


def test_right_clouds_agree_to_the_depths_noise() -> None:
    pairs = all_pairs(clouds(np.eye(4), np.random.default_rng(0)), K, side(np.zeros((6, 6))), NOISE)
    assert len(pairs) == 6
    found = stitch_result(pairs, tolerance_mm=1.0)
    assert found.check("stitch").status == "ok"
    # 0.02 px at 0.45 m are 0.2 mm; over a block a tenth of it, and edges of the slopes add a little.
    assert found.figures["distance"].value < 0.15


def test_a_wrong_mounting_shows_and_is_predicted_by_its_covariance() -> None:
    rng, measured, predicted = np.random.default_rng(1), [], []
    C = np.diag([2e-3, 2e-3, 2e-3, 2e-3, 2e-3, 2e-3]) ** 2
    for _ in range(12):
        D = se3.inverse(X) @ se3.retract(X, np.sqrt(np.diag(C)) * rng.normal(size=6))
        pairs = all_pairs(clouds(D, rng, 3), K, side(C), NOISE)
        measured += [p.rms for p in pairs]
        predicted += [p.expected for p in pairs]
    # Chi-square of some six unknowns in each of 12 draws: the ratio of squares is 1 with a sigma of sqrt(2 / 72).
    assert np.mean(np.square(measured)) / np.mean(np.square(predicted)) == pytest.approx(1, abs=4 * np.sqrt(2 / 72))


def test_a_camera_that_was_moved_fails_the_tolerance_and_its_prediction() -> None:
    D = se3.make(so3.exp([0.0, 0.015, 0.0]), [0.004, 0.0, 0.0])
    found = stitch_result(
        all_pairs(clouds(D, np.random.default_rng(2)), K, side(1e-8 * np.eye(6)), NOISE), tolerance_mm=1.0
    )
    assert found.check("stitch").status == "fail"
    assert found.check("agreement").status == "warn"


def test_clouds_that_share_nothing_are_said() -> None:
    made = clouds(np.eye(4), np.random.default_rng(3), 2)
    away = replace(made[1], T_base_depth=se3.make(np.eye(3), [5, 0, 0]) @ made[1].T_base_depth)
    with pytest.raises(InputError, match="no two depth pictures show the same surface"):
        all_pairs([made[0], away], K, side(np.zeros((6, 6))), NOISE)
    with pytest.raises(InputError, match="two poses or more"):
        all_pairs(made[:1], K, side(np.zeros((6, 6))), NOISE)
