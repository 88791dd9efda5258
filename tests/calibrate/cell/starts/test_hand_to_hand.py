"""A camera on one robot, a target on another: A X B = W C Z, closed form and joint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.calibrate.cell.calibrate import calibrate_cell
from calibrant.calibrate.cell.problem.layout import Pictures
from calibrant.calibrate.cell.starts.hand_to_hand import hand_to_hand_start
from calibrant.data import CalibrationResult, RobotPoses
from calibrant.diagnose.budget.cell import cell_budgets
from calibrant.diagnose.loop import loop_views
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.scenes import grid, look_at_board, observe, standard_camera
from calibrant.simulate.truth import normalised

CAMERA, POINTS = standard_camera(), grid(9, 7, 0.02)
X = se3.make(so3.exp([0.1, -0.2, 1.5]), [0.03, -0.05, 0.09])
Z = se3.make(so3.exp([-2.9, 0.3, 0.2]), [-0.08, 0.06, 0.12])
W = se3.make(so3.exp([0.02, -0.03, 3.0]), [1.4, 0.2, 0.05])


def arms(n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A and C at which the camera sees the whole board, and B: the board is turned by robot b, the camera follows."""
    B = look_at_board(CAMERA, POINTS, n, rng=rng, distance=(0.4, 0.7), tilt_deg=35)
    turns = so3.exp(rng.normal(scale=0.5, size=(n, 3)))
    places = rng.normal(loc=[0.6, 0.0, 0.5], scale=0.1, size=(n, 3))
    C = se3.make(turns @ so3.exp([0.0, 1.5, 0.0]), places)
    A = W @ C @ Z @ se3.inverse(B) @ se3.inverse(X)
    return A, C, B


def calibrated(seed: int, n: int = 25) -> CalibrationResult:
    rng = np.random.default_rng(seed)
    A, C, B = arms(n, rng)
    seen = observe(CAMERA, POINTS, B, sigma_px=0.1, rng=rng)
    ids = tuple(f"{i}.png" for i in range(n))
    seen = replace(seen, views=tuple(replace(v, id=i, moment=i) for v, i in zip(seen.views, ids)))
    robots = {
        name: RobotPoses(ids, noisy_poses(T, sigma_mm=0.1, sigma_deg=0.02, rng=rng)) for name, T in (("a", A), ("b", C))
    }
    lists = [Pictures("wrist", "hand-to-hand", seen, robot="a", other="b")]
    return calibrate_cell(robots, lists, cameras={"wrist": CAMERA})


def off(result: CalibrationResult, parent: str, child: str, truth: np.ndarray) -> float:
    """d^T C^-1 d / 6: 1 for an error as large as stated."""
    t = result.transform(parent, child)
    return normalised(t, truth) / 6


@pytest.mark.parametrize("seed", range(5))
def test_the_closed_form_is_exact_without_noise(seed: int) -> None:
    found = hand_to_hand_start(*arms(8, np.random.default_rng(seed)))
    for T, truth in ((found.X, X), (found.W, W), (found.Z, Z)):
        np.testing.assert_allclose(T, truth, atol=1e-6)
    assert max(found.spread) < 1e-6


def test_too_few_views_and_motions_that_tell_too_little_are_refused() -> None:
    A, C, B = arms(8, np.random.default_rng(1))
    with pytest.raises(RefusedError, match="4 usable pictures"):
        hand_to_hand_start(A[:4], C[:4], B[:4])
    with pytest.raises(RefusedError, match="do not agree"):
        hand_to_hand_start(A, C, B[::-1])
    # Robot b stands still: where its base is and where the target is on it cannot be told apart.
    still = np.tile(C[:1], (8, 1, 1))
    with pytest.raises(RefusedError, match="leaves a position open"):
        hand_to_hand_start(W @ still @ Z @ se3.inverse(B) @ se3.inverse(X), still, B)


@pytest.mark.statistics
def test_errors_are_as_large_as_stated() -> None:
    frames = (("a_gripper", "wrist", X), ("a_base", "b_base", W), ("b_gripper", "target", Z))
    results = [calibrated(seed) for seed in range(6)]
    for parent, child, truth in frames:
        # chi-square of 36 degrees over 36: within 3.3 deviations, 0.24 each; noise levels are estimated too.
        assert 0.3 < np.mean([off(r, parent, child, truth) for r in results]) < 1.8
    loop = loop_views(results[0])
    assert all(v.in_hand and v.target_carried for v in loop)
    assert np.sqrt(np.mean([v.mm**2 for v in loop if v.mm is not None])) < 1.0
    budgets = cell_budgets(results[0], target_sigma=0.0)
    assert budgets is not None
    stated = np.asarray(results[0].transform("a_gripper", "wrist").covariance)
    ratio = np.diag(budgets["wrist"].budget.covariance)[:6] / np.diag(stated)
    # The statement is averaged over what the levels of two robots' noise are uncertain by; the budget is not.
    np.testing.assert_allclose(np.sqrt(ratio), 1, atol=0.15)


def test_the_other_robot_goes_with_this_setup_alone() -> None:
    rng = np.random.default_rng(0)
    seen = observe(CAMERA, POINTS, arms(5, rng)[2], sigma_px=0.1, rng=rng)
    for setup, other in (("hand-to-hand", ""), ("eye-in-hand", "b"), ("hand-to-hand", "robot")):
        with pytest.raises(InputError, match="hand-to-hand goes with another robot"):
            Pictures("wrist", setup, seen, other=other)
