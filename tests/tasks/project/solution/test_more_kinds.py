"""Touches, bodies, joint values and bags of a project: the digits of the functions and commands behind."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.made_bags import written_bag

import calibrant as cb
from calibrant.calibrate.cell.problem.joint_offsets import JointReadings
from calibrant.calibrate.cell.problem.touches import Touches
from calibrant.data import Observations, RobotPoses
from calibrant.data.result_file import write_observations
from calibrant.errors import InputError
from calibrant.formats.projects.folder import read_project
from calibrant.geometry import se3, so3
from calibrant.robots.arms import arm
from calibrant.robots.inverse import solve_inverse
from calibrant.simulate.cell import poses_csv
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import (
    grid,
    gripper_poses,
    look_at_board,
    observe,
    standard_camera,
    standard_mounting,
)
from calibrant.targets.registry import parse_target

CAMERA, POINTS = standard_camera(), grid(9, 7, 0.02)
X, Z = standard_mounting("eye-in-hand")
TIP = np.array([0.03, -0.02, 0.18])
CORNERS = (0, 8, 54, 62, 31)


def hand(folder: Path, T: np.ndarray, seed: int) -> tuple[RobotPoses, Observations]:
    """What a wrist camera sees at poses, written as files."""
    rng = np.random.default_rng(seed)
    seen = observe(CAMERA, POINTS, se3.inverse(X) @ se3.inverse(T) @ Z, sigma_px=0.1, rng=rng)
    write_observations(seen, folder / "seen.json", force=True)
    ids = [v.id for v in seen.views]
    poses = RobotPoses.from_matrices(T, ids=ids)
    (folder / "poses.csv").write_text(poses_csv(poses))
    return poses, seen


def project_at_robot(folder: Path, **robot: object) -> Path:
    cell = folder / "cell"
    cb.project_new(cell)
    cb.project_add("robot", "ur", project=cell, **robot)
    cb.project_add("camera", "wrist", project=cell)
    cb.project_add("target", "board", project=cell, spec="chessboard:9x7:20mm")
    return cell


def some_poses(seed: int, count: int = 14) -> np.ndarray:
    rng = np.random.default_rng(seed)
    B = look_at_board(CAMERA, POINTS, count, rng=rng, distance=(0.4, 0.7), tilt_deg=35)
    return noisy_poses(gripper_poses("eye-in-hand", X, Z, B), sigma_mm=0.1, sigma_deg=0.02, rng=rng)


@pytest.mark.long
def test_touches_place_the_tip_as_the_cell_does(tmp_path: Path) -> None:
    _, seen = hand(tmp_path, some_poses(1), 1)
    rng = np.random.default_rng(2)
    at = se3.apply(Z, POINTS[list(CORNERS)]) + 1e-4 * rng.normal(size=(5, 3))
    R = so3.exp(0.5 * rng.normal(size=(5, 3))) @ so3.exp([np.pi, 0.0, 0.0])
    touched = RobotPoses.from_matrices(se3.make(R, at - R @ TIP))
    (tmp_path / "touches.csv").write_text(poses_csv(touched))
    cell = project_at_robot(tmp_path)
    at_robot = {"camera": "wrist", "target": "board", "robot": "ur", "setup": "eye-in-hand", "project": cell}
    cb.project_add("points", "hand", points=tmp_path / "seen.json", poses=tmp_path / "poses.csv", **at_robot)
    cb.project_add("tool", "probe", project=cell, robot="ur")
    cb.project_add(
        "touches", "corners", project=cell, tool="probe", robot="ur", target="board", corners="0,8,54,62,31",
        poses=tmp_path / "touches.csv",
    )  # fmt: skip
    found = cb.project_solve(project=cell).results["hand"]
    tip = found.transform("gripper", "probe")
    assert np.linalg.norm(tip.matrix[:3, 3] - TIP) < 4 * np.sqrt(np.trace(tip.covariance[3:, 3:]))
    said = {n.description: n for n in cb.read_poses(tmp_path / "poses.csv")}[found.decided["pose_reading hand"]].poses
    of_touches = next(iter(cb.read_poses(tmp_path / "touches.csv"))).poses.T_base_gripper
    ids = tuple(f"t{k}" for k in range(5))
    poses = RobotPoses((*said.ids, *ids), np.concatenate([said.T_base_gripper, of_touches]))
    mine = Observations(
        tuple(cb.View(v.id, v.points, v.uv, v.point_ids, "wrist", v.moment) for v in seen.views),
        {"wrist": CAMERA.image_size},
    )
    direct = cb.calibrate_cell(
        {"ur": poses},
        [cb.Pictures("wrist", "eye-in-hand", mine, "ur", "board")],
        touches=[Touches(ids, "ur", "probe", target="board", points=POINTS[list(CORNERS)])],
    )
    np.testing.assert_allclose(tip.matrix, direct.transform("gripper", "probe").matrix, atol=1e-9)
    assert {p.name: p for p in cb.project_list(project=cell).places}["probe"].source == "solved"
    # Another touch makes the problem stale, and a touch alone is no problem.
    cb.project_remove("corners", project=cell)
    assert {s.of: s.state for s in cb.project_status(project=cell)} == {"seen": "current", "cell": "stale"}
    cb.project_add("robot", "other", project=cell)
    cb.project_add("tool", "pin", project=cell, robot="other")
    cb.project_add("touches", "mark", project=cell, tool="pin", robot="other", poses=tmp_path / "touches.csv")
    with pytest.raises(InputError, match="touches mark: their robot has no pictures"):
        cb.project_solve(project=cell)


@pytest.mark.long
def test_joint_values_of_a_robot_find_its_errors_as_the_cell_does(tmp_path: Path) -> None:
    rng, chain, q = np.random.default_rng(3), arm("ur5e"), np.zeros((0, 6))
    while len(q) < 18:
        B = look_at_board(CAMERA, POINTS, 40, rng=rng, distance=(0.35, 0.65), tilt_deg=40)
        start = np.array([0.2, -1.6, 1.8, -1.8, -1.57, 0.3]) + rng.uniform(-0.4, 0.4, (40, 6))
        solved = solve_inverse(chain, gripper_poses("eye-in-hand", X, Z, B), start)
        q = np.concatenate([q, solved.q[solved.reached]])[:18]
    _, seen = hand(tmp_path, chain.forward(q), 3)
    read = q - np.deg2rad([0.0, 0.25, -0.3, 0.2, -0.25, 0.0])
    rows = [",".join([v.id, *(f"{x:.9f}" for x in row)]) for v, row in zip(seen.views, read)]
    (tmp_path / "joints.csv").write_text("\n".join(["image,j1,j2,j3,j4,j5,j6", *rows]) + "\n")
    cell = project_at_robot(tmp_path, chain="ur5e", joint_angle="rad", identify="offsets")
    cb.project_add(
        "points", "hand", project=cell, camera="wrist", target="board", robot="ur", setup="eye-in-hand",
        points=tmp_path / "seen.json", poses=tmp_path / "joints.csv",
    )  # fmt: skip
    found = cb.project_solve(project=cell).results["hand"]
    readings = JointReadings(tuple(v.id for v in seen.views), np.round(read, 9), chain)
    direct = cb.calibrate_cell(
        readings.poses, [cb.Pictures("camera", "eye-in-hand", seen)], joints=readings, identify=("offsets",)
    )
    np.testing.assert_allclose(
        found.transform("gripper", "wrist").matrix, direct.transform("gripper", "camera").matrix, atol=1e-8
    )
    assert np.linalg.norm(found.transform("gripper", "wrist").matrix[:3, 3] - X[:3, 3]) < 1e-3


def test_a_body_of_two_boards_ties_cameras_that_see_one_each(tmp_path: Path) -> None:
    T_A_B = se3.make(so3.exp([0.1, np.pi - 0.2, 0.05]), [0.05, -0.02, 0.12])
    T_FRONT_BACK = se3.make(so3.exp([0.02, np.pi, 0.05]), [0.1, 0.05, 1.5])
    centred, rng = POINTS - POINTS.mean(axis=0), np.random.default_rng(0)
    poses = look_at_board(CAMERA, centred, 20, rng=rng, distance=(0.6, 0.8), tilt_deg=35)
    cell = tmp_path / "cell"
    cb.project_new(cell)
    for board in ("a", "b"):
        cb.project_add("target", board, project=cell, spec="chessboard:9x7:20mm")
    for name in ("front", "back"):
        cb.project_add("camera", name, project=cell, fix="k3")
    cb.project_add("rig", "eyes", project=cell, cameras="front,back")
    cb.project_add("body", "plate", project=cell, targets="a,b")
    for name, board, T in (("front", "a", poses), ("back", "b", se3.inverse(T_FRONT_BACK) @ poses @ T_A_B)):
        views = []
        for m, M in enumerate(T):
            uv = CAMERA.project(se3.apply(M, centred)) + 0.02 * rng.normal(size=(len(centred), 2))
            inside = np.all(np.isfinite(uv) & (uv > 0) & (uv < np.array(CAMERA.image_size) - 1), axis=1)
            if inside.sum() >= 12:
                ids = np.flatnonzero(inside)
                views.append(cb.View(f"{name}-{m}", centred[inside], uv[inside], ids, "camera", str(m)))
        write_observations(Observations(tuple(views), {"camera": CAMERA.image_size}), tmp_path / f"{name}.json")
        cb.project_add("points", name, project=cell, camera=name, target=board, points=tmp_path / f"{name}.json")
    found = cb.project_solve(project=cell).results["front"]
    mm, deg = se3.deviation(T_FRONT_BACK, found.transform("front", "back").matrix)
    assert (mm < 3.0, deg < 0.2) == (True, True)
    assert se3.deviation(T_A_B, found.transform("a", "b").matrix)[0] < 1.0


@pytest.mark.long
def test_a_bag_at_a_robot_has_the_digits_of_hand_eye(tmp_path: Path) -> None:
    board = parse_target("chessboard:7x6:30mm")
    camera = cb.Camera.create("pinhole", {"fx": 430.0, "fy": 428.0, "cx": 241.0, "cy": 178.0}, image_size=(480, 360))
    rng = np.random.default_rng(5)
    B = look_at_board(camera, board.points, 9, rng=rng, distance=(0.35, 0.6), tilt_deg=45)
    T = gripper_poses("eye-in-hand", X, Z, B)
    with written_bag(tmp_path, "mcap") as (bag, writer):
        for k, (place, M) in enumerate(zip(T, B)):
            picture = render(board.artwork(), camera, M, rng=rng, look=Look(clutter=0, noise_grey=2.0))
            for t in np.arange(2.0 * k, 2.0 * k + 1.0, 0.05):
                writer.transforms("/tf", {("base_link", "tool0"): place}, t)
            for t in (0.2, 0.5, 0.8):
                writer.image("/wrist/image_raw", picture, 2.0 * k + t, "mono8")
    cell = project_at_robot(tmp_path)
    cb.project_add("target", "small", project=cell, spec="chessboard:7x6:30mm")
    of_bag = {"bag": bag, "image_topic": "/wrist/image_raw", "tf": "base_link:tool0"}
    cb.project_add("bag", "run", project=cell, camera="wrist", target="small", robot="ur", **of_bag)
    found = cb.project_solve(project=cell).results["run"]
    expected = cb.hand_eye(target="chessboard:7x6:30mm", **of_bag)
    np.testing.assert_array_equal(
        found.transform("gripper", "wrist").matrix, expected.transform("gripper", "camera").matrix
    )
    assert found.check("moments").message == expected.check("moments").message
    assert {s.state for s in cb.project_status(project=cell)} == {"current"}
    # What a bag does not have is said when it is added.
    cut = tmp_path / "cut.mcap"
    whole = next(bag.glob("*.mcap")).read_bytes()
    cut.write_bytes(whole[: len(whole) // 2])
    for wrong, words in (
        ({**of_bag, "image_topic": "/none"}, r"no pictures under /none; it has /wrist/image_raw \(27 pictures\)"),
        ({**of_bag, "tf": "base_link:flange"}, r"has no frame 'flange'; its frames are\n +base_link\n +tool0 \*"),
        ({**of_bag, "bag": cut}, "is cut off or damaged"),
    ):
        with pytest.raises(InputError, match=words):
            cb.project_add("bag", "no", project=cell, camera="wrist", target="small", robot="ur", **wrong)
    assert "no" not in read_project(cell).observations
