"""The budget of several cameras: its sources sum to the covariance that the joint calibration states."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.calibrate.cell.calibrate import calibrate_cell
from calibrant.calibrate.cell.problem.layout import Pictures
from calibrant.data import CalibrationResult, Observations, RobotPoses
from calibrant.data.details import RobotParameters
from calibrant.diagnose.budget.cell import cell_budgets
from calibrant.diagnose.budget.volume import parse_volume
from calibrant.diagnose.budget.workspace import workspace_of_cameras
from calibrant.diagnose.loop import loop_views
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.scenes import grid, gripper_poses, look_at_board, observe, standard_camera, standard_mounting

CAMERA, POINTS = standard_camera(), grid(9, 7, 0.02)
X, Z = standard_mounting("eye-in-hand")
X_TOP, Z_GRIPPER = standard_mounting("eye-to-hand")
SECOND_BASE = se3.make(so3.exp([0.01, 0.02, 2.0]), [1.3, 0.4, 0.05])
N = 25


def sees(B: np.ndarray, rng: np.random.Generator) -> Observations:
    seen = observe(CAMERA, POINTS, B, sigma_px=0.1, rng=rng)
    return replace(seen, views=tuple(replace(v, id=f"{i}.png", moment=f"{i}.png") for i, v in enumerate(seen.views)))


def said(T: np.ndarray, rng: np.random.Generator) -> RobotPoses:
    return RobotPoses(tuple(f"{i}.png" for i in range(N)), noisy_poses(T, sigma_mm=0.2, sigma_deg=0.03, rng=rng))


@pytest.fixture(scope="module")
def cell() -> CalibrationResult:
    """A wrist camera of robot a, and one beside it that sees what robots a and b carry."""
    rng = np.random.default_rng(2)
    B = [look_at_board(CAMERA, POINTS, N, rng=rng, distance=(0.4, 0.7), tilt_deg=35) for _ in range(3)]
    hand = gripper_poses("eye-in-hand", X, Z, B[0])
    carried = gripper_poses("eye-to-hand", X_TOP, Z_GRIPPER, B[1])
    other = gripper_poses("eye-to-hand", se3.inverse(SECOND_BASE) @ X_TOP, Z_GRIPPER, B[2])
    ids = [f"{i}.png" for i in range(N)]
    poses = RobotPoses(
        (*(f"hand {i}" for i in ids), *ids),
        noisy_poses(np.concatenate([hand, carried]), sigma_mm=0.2, sigma_deg=0.03, rng=rng),
    )
    wrist = sees(B[0], rng)
    wrist = replace(wrist, views=tuple(replace(v, moment=f"hand {v.moment}") for v in wrist.views))
    lists = [
        Pictures("wrist", "eye-in-hand", wrist, robot="a"),
        Pictures("top", "eye-to-hand", sees(B[1], rng), robot="a"),
        Pictures("top", "eye-to-hand", sees(B[2], rng), robot="b"),
    ]
    return calibrate_cell({"a": poses, "b": said(other, rng)}, lists, cameras={"wrist": CAMERA, "top": CAMERA})


def test_sources_sum_to_the_stated_covariance_from_the_file_alone(cell: CalibrationResult, tmp_path: Path) -> None:
    result = cb.read(cell.write(tmp_path / "result.json"))
    budgets = cell_budgets(result, target_sigma=0.0)
    assert budgets is not None
    assert set(budgets) == {"wrist", "top"}
    for frame, budget in ((("a_gripper", "wrist"), budgets["wrist"]), (("a_base", "top"), budgets["top"])):
        stated = np.asarray(result.transform(*frame).covariance)
        # The statement is averaged over what the noise levels are uncertain by, some per cent; the budget is not.
        np.testing.assert_allclose(np.sqrt(np.diag(budget.budget.covariance[:6, :6]) / np.diag(stated)), 1, atol=0.08)


def test_size_moves_a_camera_by_its_share_of_the_distance(cell: CalibrationResult) -> None:
    none, some = (cell_budgets(replace(cell, target_scale=None), target_sigma=s) for s in (0.0, 1e-3))
    assert none is not None
    assert some is not None
    shift = 1e3 * np.sqrt(np.trace(some["top"].budget.sources["target"][3:6, 3:6]))
    # The robot's motion holds the boards, so that the camera moves by at most a thousandth of their distance, 0.7 m.
    assert 0.1 < shift < 0.9
    assert np.trace(none["top"].budget.sources["target"]) == 0


def test_a_workspace_for_every_camera(cell: CalibrationResult) -> None:
    found = workspace_of_cameras(cell, parse_volume("300mm:600mm,-100mm:100mm,0mm:100mm"))
    assert set(found) == {"wrist", "top"}
    assert found["wrist"].base == found["top"].base == "a_base"
    for one in found.values():
        assert 0.02 < one.centre.sigma_mm < 2


def test_free_joints_are_refused_in_words(cell: CalibrationResult) -> None:
    with pytest.raises(InputError, match="not available with --identify"):
        cell_budgets(cell.with_detail(RobotParameters({})), target_sigma=0.0)


def test_the_loop_of_every_camera_and_robot_is_drawn(cell: CalibrationResult) -> None:
    loop = loop_views(cell)
    assert {(v.camera, v.in_hand) for v in loop} == {("wrist", True), ("top", False)}
    assert len(loop) == 3 * N
    # 0.2 mm and 0.03 deg on levers of half a metre: a board's place is off by about 0.5 mm.
    assert np.sqrt(np.mean([v.mm**2 for v in loop if v.mm is not None])) < 1.0
    assert len({v.key for v in loop}) == 3 * N
