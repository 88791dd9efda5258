"""Projectors are components of a cell: the same digits as `calibrate_projector`, and placed beside robots."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.calibrate.cell.calibrate import calibrate_cell
from calibrant.calibrate.cell.problem.layout import HANDHELD, Pictures
from calibrant.calibrate.projector.calibrate import calibrate_projector
from calibrant.data import CalibrationResult, Observations, RobotPoses
from calibrant.errors import InputError
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.projector.points import ProjectorPair, board_poses, carried_views, example_pair
from calibrant.simulate.scenes import grid, gripper_poses, standard_mounting
from calibrant.simulate.truth import normalised

POINTS = grid(9, 7, 0.03)
X, Z = standard_mounting("eye-in-hand")


def lit(pair: ProjectorPair, seed: int, *, views: int = 10, noise: float = 1.0) -> tuple[np.ndarray, Observations]:
    rng = np.random.default_rng(seed)
    B = board_poses(pair, POINTS, views, rng, distance=(0.7, 1.1))
    return B, carried_views(pair, POINTS, B, rng, corner_px=0.05 * noise, decoded_px=0.03 * noise)


def lists(seen: Observations, setup: str, target: str = "target") -> list[Pictures]:
    return [Pictures(name, setup, seen.of_camera(name), target=target) for name in ("camera", "projector")]


def scanner(seed: int, *, noise: float = 1.0) -> CalibrationResult:
    """Camera and projector in a gripper over one board."""
    B, seen = lit(example_pair(), seed, views=14, noise=noise)
    T = gripper_poses("eye-in-hand", X, Z, B)
    said = noisy_poses(T, sigma_mm=0.1 * noise, sigma_deg=0.02 * noise, rng=np.random.default_rng(1000 + seed))
    poses = RobotPoses(tuple(f"{k:02d}" for k in range(14)), said)
    return calibrate_cell(poses, lists(seen, "eye-in-hand"))


@pytest.mark.long
def test_one_camera_and_one_projector_are_the_cell_digit_for_digit() -> None:
    _, seen = lit(example_pair(), 0)
    cell, projector = calibrate_cell({}, lists(seen, HANDHELD)), calibrate_projector(seen)
    for name in ("camera", "projector"):
        np.testing.assert_array_equal(cell.cameras[name].values, projector.cameras[name].values)
        np.testing.assert_array_equal(cell.cameras[name].covariance, projector.cameras[name].covariance)
    for a, b in zip(cell.transforms, projector.transforms, strict=True):
        np.testing.assert_array_equal(a.matrix, b.matrix)
        np.testing.assert_array_equal(a.covariance, b.covariance)
    assert cell.checks == projector.checks


@pytest.mark.long
def test_a_scanner_in_a_gripper_is_exact_without_noise() -> None:
    pair, result = example_pair(), scanner(1, noise=0.0)
    np.testing.assert_allclose(result.transform("gripper", "camera").matrix, X, atol=1e-5)
    np.testing.assert_allclose(result.transform("camera", "projector").matrix, pair.T_camera_projector, atol=1e-5)


@pytest.mark.long
def test_a_projector_that_boards_held_by_hand_place_beside_a_robot() -> None:
    """The robot shows its board to the camera; boards held by hand are lit by the projector before the same camera."""
    pair = example_pair()
    _, seen = lit(pair, 2)
    X_top, Z_gripper = standard_mounting("eye-to-hand")
    B, shown = lit(pair, 3, views=12)
    T = noisy_poses(gripper_poses("eye-to-hand", X_top, Z_gripper, B), sigma_mm=0.1, sigma_deg=0.02,
                    rng=np.random.default_rng(4))  # fmt: skip
    poses = RobotPoses(tuple(f"{k:02d}" for k in range(12)), T)
    robot = Pictures("camera", "eye-to-hand", shown.of_camera("camera"))
    result = calibrate_cell(poses, [robot, *lists(seen, HANDHELD, "held")])
    assert normalised(result.transform("camera", "projector"), pair.T_camera_projector) / 6 < 4
    assert normalised(result.transform("base", "projector"), X_top @ pair.T_camera_projector) / 6 < 4
    assert result.joint_covariance is not None
    assert set(result.joint_covariance.cameras) == {"camera", "projector"}
    # The lens that hand-eye's pictures tell better tells the projector better, too.
    alone = calibrate_projector(seen)
    assert result.cameras["camera"].sigma["fx"] < 0.9 * alone.cameras["camera"].sigma["fx"]
    assert {c.status for c in result.checks if c.name.startswith(("weak-terms", "lens-shift"))} == {"ok"}


@pytest.mark.statistics
def test_errors_of_a_scanner_match_their_covariance() -> None:
    pair = example_pair()
    truths = {("gripper", "camera"): X, ("camera", "projector"): pair.T_camera_projector}
    scores: dict[tuple[str, str], list[float]] = {frame: [] for frame in truths}
    for seed in range(12):
        result = scanner(100 + seed)
        for frame, truth in truths.items():
            scores[frame].append(normalised(result.transform(*frame), truth))
    # Means of 12 values of deviation sqrt(12): 6 +- 1; three sigmas allowed.
    assert {f: np.mean(v) for f, v in scores.items() if not 3.0 < np.mean(v) < 9.0} == {}


def test_projectors_that_do_not_fit_are_named() -> None:
    _, seen = lit(example_pair(), 5)
    camera, projector = lists(seen, HANDHELD)
    assert projector.seen is not None
    views = list(projector.seen.views)
    views[3] = replace(views[3], carried=None)
    with pytest.raises(InputError, match="all its points are carried from one camera"):
        calibrate_cell({}, [camera, replace(projector, observations=replace(projector.seen, views=tuple(views)))])
    with pytest.raises(InputError, match="which has no pictures"):
        calibrate_cell({}, [projector, replace(projector, camera="other")])
    apart = replace(projector, target="another")
    with pytest.raises(InputError, match="taken in the same setup at the same moments"):
        calibrate_cell({}, [camera, apart])
