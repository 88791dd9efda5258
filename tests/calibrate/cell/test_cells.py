"""Several cameras and robots in one problem: the truth recovered, and a covariance that tells the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.calibrate.cell.boards.turned import NAME, board_turns, turned_views
from calibrant.calibrate.cell.calibrate import calibrate_cell
from calibrant.calibrate.cell.problem.layout import Pictures
from calibrant.data import CalibrationResult, Observations, RobotPoses
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.scenes import grid, gripper_poses, look_at_board, observe, standard_camera, standard_mounting
from calibrant.simulate.truth import normalised

CAMERA, POINTS = standard_camera(), grid(9, 7, 0.02)
IDS = tuple(f"{i}.png" for i in range(14))
X_LEFT, Z_TABLE = standard_mounting("eye-in-hand")
X_RIGHT = X_LEFT @ se3.make(so3.exp([0.02, -0.06, 0.05]), [0.06, 0.005, 0.0])
X_TOP, Z_GRIPPER = standard_mounting("eye-to-hand")
SECOND_BASE = se3.make(so3.exp([0.01, 0.02, 2.0]), [1.3, 0.4, 0.05])


def sees(T_camera_target: np.ndarray, rng: np.random.Generator, *, sigma_px: float = 0.1) -> Observations:
    """What a camera sees, its views called as the poses are; views without the whole board come without some points."""
    seen = observe(CAMERA, POINTS, T_camera_target, sigma_px=sigma_px, rng=rng)
    views = tuple(replace(v, id=i, moment=i) for v, i in zip(seen.views, IDS) if len(v) >= 12)
    return replace(seen, views=views)


def wrist(rng: np.random.Generator, n: int = 14) -> np.ndarray:
    """T_base_gripper at which the left camera sees the whole board on the table."""
    B = look_at_board(CAMERA, POINTS, n, rng=rng, distance=(0.4, 0.7), tilt_deg=35)
    return gripper_poses("eye-in-hand", X_LEFT, Z_TABLE, B)


def said(T: np.ndarray, rng: np.random.Generator) -> RobotPoses:
    return RobotPoses(IDS[: len(T)], noisy_poses(T, sigma_mm=0.2, sigma_deg=0.03, rng=rng))


def in_hand(T: np.ndarray, X: np.ndarray, Z: np.ndarray = Z_TABLE) -> np.ndarray:
    return se3.inverse(X) @ se3.inverse(T) @ Z


def two_in_hand(rng: np.random.Generator) -> CalibrationResult:
    T = wrist(rng)
    pictures = [
        Pictures("left", "eye-in-hand", sees(in_hand(T, X_LEFT), rng)),
        Pictures("right", "eye-in-hand", sees(in_hand(T, X_RIGHT), rng)),
    ]
    return calibrate_cell(said(T, rng), pictures, cameras={"left": CAMERA, "right": CAMERA})


def off(result: CalibrationResult, parent: str, child: str, truth: np.ndarray) -> float:
    """sqrt(d^T C^-1 d / 6): 1 for an error as large as stated."""
    t = result.transform(parent, child)
    return float(np.sqrt(normalised(t, truth) / 6))


def test_two_cameras_on_one_gripper_and_the_transform_between_them() -> None:
    result = two_in_hand(np.random.default_rng(1))
    between = se3.inverse(X_LEFT) @ X_RIGHT
    # sqrt of chi-square(6) / 6 is below 2 in all but 1 in 2000 cases.
    assert off(result, "gripper", "left", X_LEFT) < 2
    assert off(result, "gripper", "right", X_RIGHT) < 2
    assert off(result, "left", "right", between) < 2
    # Both cameras share the robot's errors, which cancel between them.
    alone = np.linalg.norm(result.transform("gripper", "left").sigma_translation_mm)
    assert np.linalg.norm(result.transform("left", "right").sigma_translation_mm) < 0.8 * alone
    assert result.verdict == "ok"
    assert result.sigma_px == pytest.approx(0.1, rel=0.1)
    assert result.sigma_robot is not None
    assert result.sigma_robot.mm == pytest.approx(0.2, rel=0.4)


def test_cameras_that_number_a_symmetric_board_from_different_ends() -> None:
    """9x7 circles look the same turned by half: the right camera hangs upside down, and both number some views anew."""
    rng = np.random.default_rng(2)
    spec = "circles:9x7:20mm"
    turns = board_turns(spec)
    assert turns is not None
    T = wrist(rng)
    pictures = []
    for name, X, rows in (("left", X_LEFT, [1, 4, 5, 9, 12]), ("right", X_RIGHT, [0, 1, 2, 3, 5, 7, 8, 9, 11])):
        seen = sees(in_hand(T, X), rng)
        views = turned_views(seen.views, [i for i, v in enumerate(seen.views) if IDS.index(v.id) in rows], turns.F[1])
        pictures.append(Pictures(name, "eye-in-hand", replace(seen, views=views, target=spec)))
    result = calibrate_cell(said(T, rng), pictures, cameras={"left": CAMERA, "right": CAMERA})
    messages = [c.message for c in result.checks if c.name == NAME]
    assert len(messages) == 3
    assert "from the end that the other cameras' views start at" in messages[2]
    # sqrt of chi-square(6) / 6 is below 2 in all but 1 in 2000 cases.
    assert off(result, "gripper", "left", X_LEFT) < 2
    assert off(result, "gripper", "right", X_RIGHT) < 2
    # A view of a wrong end is off by half a turn: the loop would leave it out.
    assert [v.reason for v in result.views if not v.used and "points" not in (v.reason or "")] == []


@pytest.mark.statistics
@pytest.mark.parametrize(("parent", "child"), [("gripper", "left"), ("left", "right"), ("base", "target")])
def test_covariances_tell_the_truth(parent: str, child: str) -> None:
    truth = {"left": X_LEFT, "right": se3.inverse(X_LEFT) @ X_RIGHT, "target": Z_TABLE}[child]
    n = 12
    total = sum(6 * off(_trial(seed), parent, child, truth) ** 2 for seed in range(n))
    # chi-square with 72 degrees of freedom: within 3.3 deviations (12) of 72, noise levels being estimated too.
    assert 72 - 3.3 * 12 < total < 72 + 3.3 * 12


_TRIALS: dict[int, CalibrationResult] = {}


def _trial(seed: int) -> CalibrationResult:
    if seed not in _TRIALS:
        _TRIALS[seed] = two_in_hand(np.random.default_rng(100 + seed))
    return _TRIALS[seed]


def test_the_joint_covariance_holds_the_blocks_of_the_transforms(tmp_path: Path) -> None:
    result = _trial(0)
    joint = result.joint_covariance
    assert joint is not None
    for k, frame in enumerate(joint.frames):
        block = joint.matrix[6 * k : 6 * k + 6, 6 * k : 6 * k + 6]
        np.testing.assert_allclose(block, result.transform(*frame).covariance, rtol=1e-9)
    again = cb.read(result.write(tmp_path / "result.json"))
    assert again.joint_covariance is not None
    assert again.joint_covariance.frames == joint.frames
    np.testing.assert_array_equal(again.joint_covariance.matrix, joint.matrix)


def test_a_camera_with_two_pictures_is_found_through_the_others() -> None:
    rng = np.random.default_rng(3)
    T = wrist(rng)
    right = sees(in_hand(T, X_RIGHT), rng)
    pictures = [
        Pictures("left", "eye-in-hand", sees(in_hand(T, X_LEFT), rng)),
        Pictures("right", "eye-in-hand", replace(right, views=right.views[:2])),
    ]
    result = calibrate_cell(said(T, rng), pictures, cameras={"left": CAMERA, "right": CAMERA})
    assert off(result, "gripper", "right", X_RIGHT) < 2


def test_wrist_camera_fixed_camera_and_onlooker_in_one_problem() -> None:
    rng = np.random.default_rng(4)
    T = wrist(rng)
    B = look_at_board(CAMERA, POINTS, 12, rng=rng, distance=(0.5, 0.9), tilt_deg=35)
    carried = gripper_poses("eye-to-hand", X_TOP, Z_GRIPPER, B)
    poses = RobotPoses(
        (*IDS, *(f"top {i}" for i in range(12))),
        noisy_poses(np.concatenate([T, carried]), sigma_mm=0.2, sigma_deg=0.03, rng=rng),
    )
    top = observe(CAMERA, POINTS, B, sigma_px=0.1, rng=rng)
    top = replace(top, views=tuple(replace(v, id=f"top {i}", moment=f"top {i}") for i, v in enumerate(top.views)))
    T_base_side = Z_TABLE @ se3.inverse(se3.make(so3.exp([0.2, -0.3, 0.4]), [-0.08, -0.06, 0.6]))
    side = sees((se3.inverse(T_base_side) @ Z_TABLE)[None], rng)
    pictures = [
        Pictures("wrist", "eye-in-hand", sees(in_hand(T, X_LEFT), rng)),
        Pictures("top", "eye-to-hand", top),
        Pictures("side", "standing", side),
    ]
    result = calibrate_cell(poses, pictures, cameras=dict.fromkeys(("wrist", "top", "side"), CAMERA))
    assert off(result, "gripper", "wrist", X_LEFT) < 2
    assert off(result, "base", "top", X_TOP) < 2
    assert off(result, "base", "side", T_base_side) < 2
    assert off(result, "base", "base_target", Z_TABLE) < 2
    assert off(result, "gripper", "gripper_target", Z_GRIPPER) < 2
    assert off(result, "top", "side", se3.inverse(X_TOP) @ T_base_side) < 2


def test_two_robots_that_show_their_targets_to_one_camera() -> None:
    rng = np.random.default_rng(5)
    lists, robots = [], {}
    for robot, base in (("a", np.eye(4)), ("b", SECOND_BASE)):
        B = look_at_board(CAMERA, POINTS, 12, rng=rng, distance=(0.5, 0.9), tilt_deg=35)
        T = gripper_poses("eye-to-hand", se3.inverse(base) @ X_TOP, Z_GRIPPER, B)
        robots[robot] = said(T, rng)
        lists.append(Pictures("top", "eye-to-hand", sees(B, rng), robot=robot))
    result = calibrate_cell(robots, lists, cameras={"top": CAMERA})
    assert off(result, "a_base", "top", X_TOP) < 2
    assert off(result, "a_base", "b_base", SECOND_BASE) < 2
    assert off(result, "b_gripper", "b_gripper_target", Z_GRIPPER) < 2


def test_two_robots_whose_cameras_see_one_target() -> None:
    rng = np.random.default_rng(6)
    T = wrist(rng)
    other = se3.inverse(SECOND_BASE) @ wrist(rng)
    lists = [
        Pictures("one", "eye-in-hand", sees(in_hand(T, X_LEFT), rng), robot="a"),
        Pictures("two", "eye-in-hand", sees(in_hand(SECOND_BASE @ other, X_LEFT), rng), robot="b"),
    ]
    result = calibrate_cell({"a": said(T, rng), "b": said(other, rng)}, lists, cameras={"one": CAMERA, "two": CAMERA})
    assert off(result, "a_base", "b_base", SECOND_BASE) < 2
    assert off(result, "b_gripper", "two", X_LEFT) < 2


def test_one_wrong_pose_is_left_out_of_both_cameras() -> None:
    rng = np.random.default_rng(7)
    T = wrist(rng)
    poses = said(T, rng)
    wrong = poses.T_base_gripper.copy()
    wrong[5] = se3.retract(wrong[5], np.array([0.0, 0.03, 0.0, 0.01, 0.0, 0.0]))
    pictures = [
        Pictures("left", "eye-in-hand", sees(in_hand(T, X_LEFT), rng)),
        Pictures("right", "eye-in-hand", sees(in_hand(T, X_RIGHT), rng)),
    ]
    result = calibrate_cell(RobotPoses(IDS, wrong), pictures, cameras={"left": CAMERA, "right": CAMERA})
    assert {v.id for v in result.views if not v.used} == {"5.png"}
    assert off(result, "gripper", "left", X_LEFT) < 2


def test_robots_with_nothing_in_common_are_refused_by_name() -> None:
    rng = np.random.default_rng(8)
    T = wrist(rng)
    lists = [
        Pictures("one", "eye-in-hand", sees(in_hand(T, X_LEFT), rng), robot="a", target="first"),
        Pictures("two", "eye-in-hand", sees(in_hand(T, X_LEFT), rng), robot="b", target="second"),
    ]
    with pytest.raises(RefusedError, match="nothing ties b_base to a_base"):
        calibrate_cell({"a": said(T, rng), "b": said(T, rng)}, lists, cameras={"one": CAMERA, "two": CAMERA})


def test_names_that_do_not_fit_are_said() -> None:
    rng = np.random.default_rng(9)
    T = wrist(rng)
    seen = sees(in_hand(T, X_LEFT), rng)
    with pytest.raises(InputError, match="unknown setup"):
        Pictures("left", "eye-in-foot", seen)
    with pytest.raises(InputError, match="cannot be fixed to both"):
        calibrate_cell(said(T, rng), [Pictures("c", "eye-in-hand", seen), Pictures("c", "eye-to-hand", seen)])
    with pytest.raises(InputError, match="has no pictures"):
        calibrate_cell(said(T, rng), [Pictures("c", "eye-in-hand", seen)], cameras={"d": CAMERA})
    with pytest.raises(InputError, match="name of another frame"):
        calibrate_cell(said(T, rng), [Pictures("base", "eye-in-hand", seen)])


def test_cameras_that_were_not_at_one_pose_are_said() -> None:
    rng = np.random.default_rng(12)
    T = wrist(rng)
    elsewhere = noisy_poses(T, sigma_mm=0.5, sigma_deg=0.1, rng=rng)
    pictures = [
        Pictures("left", "eye-in-hand", sees(in_hand(T, X_LEFT), rng)),
        Pictures("right", "eye-in-hand", sees(in_hand(elsewhere, X_RIGHT), rng)),
    ]
    result = calibrate_cell(said(T, rng), pictures, cameras={"left": CAMERA, "right": CAMERA})
    assert "warn" in {result.check(f"together-{c}").status for c in ("left", "right")}
    assert {_trial(0).check(f"together-{c}").status for c in ("left", "right")} == {"ok"}


def test_the_old_name_is_another_name() -> None:
    assert cb.calibrate_several is cb.calibrate_cell
