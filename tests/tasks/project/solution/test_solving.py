"""Projects solved: the digits of `calibrate_cell`, and nothing made anew that did not change."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import calibrant as cb
from calibrant.data import Observations, RobotPoses
from calibrant.data.result_file import write_observations
from calibrant.formats.projects.folder import read_project
from calibrant.geometry import se3, so3
from calibrant.simulate.cell import poses_csv
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.projector.points import board_poses, carried_views, example_pair
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import grid, gripper_poses, look_at_board, standard_mounting
from calibrant.targets.registry import parse_target
from calibrant.tasks.project.solution.solving import solve_project

POINTS = grid(6, 5, 0.045)
T_LEFT_RIGHT = se3.make(so3.exp([0.0, -0.05, 0.0]), [0.12, 0.0, 0.0])
X, Z = standard_mounting("eye-in-hand")
VIEWS = 10
BOARD = "chessboard:7x6:30mm"


def scanner(folder: Path) -> tuple[RobotPoses, Observations, Observations]:
    """Two cameras and a projector in a gripper over a board: the poses, what left and projector saw, what right did."""
    pair, rng = example_pair(), np.random.default_rng(1)
    B = board_poses(pair, POINTS, VIEWS, rng, distance=(0.7, 1.1))
    lit = carried_views(pair, POINTS, B, rng, corner_px=0.05, decoded_px=0.03)
    T = noisy_poses(gripper_poses("eye-in-hand", X, Z, B), sigma_mm=0.1, sigma_deg=0.02, rng=rng)
    ids = [v.id for v in lit.views if v.camera == "camera"]
    (folder / "poses.csv").write_text(poses_csv(RobotPoses.from_matrices(T, ids=ids)))
    views = []
    for name, T_left_board in zip(ids, B):
        uv = pair.camera.project(se3.apply(se3.inverse(T_LEFT_RIGHT) @ T_left_board, POINTS))
        inside = np.isfinite(uv).all(1) & (uv > 0).all(1) & (uv < np.array(pair.camera.image_size) - 1).all(1)
        if inside.sum() >= 12:
            uv = uv[inside] + rng.normal(scale=0.05, size=(inside.sum(), 2))
            views.append(cb.View(name, POINTS[inside], uv, np.flatnonzero(inside)))
    right = Observations(tuple(views), {"camera": pair.camera.image_size})
    write_observations(lit, folder / "lit.json", force=True)
    write_observations(right, folder / "right.json", force=True)
    poses = {n.description: n for n in cb.read_poses(folder / "poses.csv")}
    reading = next(n for n in poses.values() if np.allclose(n.T_base_gripper, T, atol=1e-6))
    return reading.poses, lit, right


def scanner_project(folder: Path) -> Path:
    cell = folder / "cell"
    cb.project_new(cell)
    for kind, name, more in (
        ("robot", "ur", {}),
        ("camera", "left", {}),
        ("camera", "right", {}),
        ("projector", "light", {"camera": "left", "projector_size": "1024x768"}),
        ("target", "board", {"spec": "chessboard:6x5:45mm"}),
    ):
        cb.project_add(kind, name, project=cell, **more)
    at = {"target": "board", "setup": "eye-in-hand", "robot": "ur", "poses": folder / "poses.csv", "project": cell}
    cb.project_add("points", "scan", camera="left", projector="light", points=folder / "lit.json", **at)
    cb.project_add("points", "beside", camera="right", points=folder / "right.json", **at)
    return cell


def called(seen: Observations, old: str, new: str) -> Observations:
    """One camera's views under another name."""
    mine = seen.of_camera(old)
    views = tuple(
        replace(v, camera=new, carried=None if v.carried is None else replace(v.carried, camera="left"))
        for v in mine.views
    )
    return replace(mine, views=views, image_sizes={new: mine.image_sizes[old]})


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_two_cameras_a_projector_and_a_robot_have_the_digits_of_the_cell(tmp_path: Path) -> None:
    poses, lit, right = scanner(tmp_path)
    cell = scanner_project(tmp_path)
    solved = cb.project_solve(project=cell)
    assert not solved.refused
    found = solved.results["scan"]
    pictures = [
        cb.Pictures("left", "eye-in-hand", called(lit, "camera", "left"), "ur", "board"),
        cb.Pictures("light", "eye-in-hand", called(lit, "projector", "light"), "ur", "board"),
        cb.Pictures("right", "eye-in-hand", called(right, "camera", "right"), "ur", "board"),
    ]
    direct = cb.calibrate_cell({"ur": poses}, pictures)
    assert [(t.parent, t.child) for t in found.transforms] == [(t.parent, t.child) for t in direct.transforms]
    for mine, theirs in zip(found.transforms, direct.transforms):
        np.testing.assert_array_equal(mine.matrix, theirs.matrix)
        np.testing.assert_array_equal(mine.covariance, theirs.covariance)
    for name in ("left", "right", "light"):
        np.testing.assert_array_equal(found.cameras[name].values, direct.cameras[name].values)
    read = cb.read(cell / next(k.file for k in read_project(cell).results if k.of == "cell"))
    np.testing.assert_array_equal(
        read.transform("gripper", "light").matrix, direct.transform("gripper", "light").matrix
    )

    again = solve_project(cell, command="again")
    assert (again.made, [s.of for s in again.kept]) == ((), ["seen", "seen", "cell"])
    cb.project_rename("light", "lamp", project=cell)
    cb.project_rename("ur", "arm", project=cell)
    assert {s.state for s in cb.project_status(project=cell)} == {"current"}
    places = {p.name: p for p in cb.project_list(project=cell, relative_to="lamp").places}
    np.testing.assert_allclose(places["left"].T, se3.inverse(direct.transform("left", "light").matrix), atol=1e-12)
    assert places["left"].sigma_mm is not None
    assert places["board"].relative_to == "arm"


@pytest.fixture(scope="module", name="photos")
def photos_of_two_cameras(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Seven photos of a board by a camera, and six by another that knows nothing of it."""
    folder = tmp_path_factory.mktemp("photos")
    camera = cb.Camera.create("pinhole", {"fx": 430.0, "fy": 428.0, "cx": 241.0, "cy": 178.0}, image_size=(480, 360))
    target, rng = parse_target(BOARD), np.random.default_rng(7)
    for name, count in (("front", 7), ("side", 6)):
        (folder / name).mkdir()
        T = look_at_board(camera, target.points, count, rng=rng, distance=(0.35, 0.6), tilt_deg=45)
        for i, T_camera_target in enumerate(T):
            image = render(target.artwork(), camera, T_camera_target, rng=rng, look=Look(clutter=0, noise_grey=2.0))
            cv2.imwrite(str(folder / name / f"{i:02d}.png"), image)
    return folder


def test_one_image_added_makes_anew_what_rests_on_it_alone(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = tmp_path / "cell"
    cb.project_new(cell)
    cb.project_add("target", "board", project=cell, spec=BOARD)
    for name in ("front", "side"):
        (cell / name).mkdir()
        for file in sorted((photos / name).iterdir())[:6]:
            (cell / name / file.name).write_bytes(file.read_bytes())
        cb.project_add("camera", name, project=cell, fix="k3")
        cb.project_add("images", name, project=cell, camera=name, target="board", images=cell / name)
    first = solve_project(cell, command="first")
    assert [(s.of, s.name) for s in first.made] == [
        ("seen", "front"),
        ("seen", "side"),
        ("cell", "front"),
        ("cell", "side"),
    ]
    assert first.results["side"].cameras["side"].parameters["fx"] == pytest.approx(430.0, abs=3.0)
    before = {k.name: k for k in read_project(cell).results if k.of == "cell"}

    (cell / "front" / "06.png").write_bytes((photos / "front" / "06.png").read_bytes())
    stale = {(s.of, s.name): s for s in cb.project_status(project=cell)}
    assert {key: s.state for key, s in stale.items()} == {
        ("seen", "front"): "stale", ("seen", "side"): "current", ("cell", "front"): "stale", ("cell", "side"): "current"
    }  # fmt: skip
    assert stale["seen", "front"].why == "1 file added: front/06.png"
    assert stale["cell", "front"].why == "1 file added: front/06.png"

    second = solve_project(cell, command="second")
    assert [(s.of, s.name) for s in second.made] == [("seen", "front"), ("cell", "front")]
    assert [(s.of, s.name) for s in second.kept] == [("seen", "side"), ("cell", "side")]
    after = {k.name: k for k in read_project(cell).results if k.of == "cell"}
    assert after["side"] == before["side"]
    assert len([v for v in second.results["front"].views if v.used]) == 7
    # The same as if all had been there from the start.
    whole = cb.intrinsics(cell / "front", target=BOARD, fix="k3")
    np.testing.assert_array_equal(second.results["front"].cameras["front"].values, whole.camera.values)

    moved = cell.rename(tmp_path / "moved")
    assert {s.state for s in cb.project_status(project=moved)} == {"current"}
    monkeypatch.chdir(moved / "front")
    assert {s.state for s in cb.project_status(project="..")} == {"current"}


@pytest.mark.long
def test_a_typed_pose_gives_way_to_one_that_is_found(tmp_path: Path) -> None:
    scanner(tmp_path)
    cell = scanner_project(tmp_path)
    cb.project_set("right", project=cell, relative_to="gripper", xyz="1mm,2mm,3mm")
    cb.project_add("frame", "table", project=cell)
    cb.project_set("table", project=cell, relative_to="base", xyz="0mm,0mm,-5mm")
    solved = solve_project(cell, command="solve")
    assert solved.replaced == ("right",)
    places = {p.name: p for p in cb.project_list(project=cell).places}
    assert (places["right"].source, places["table"].source) == ("solved", "typed in")
    cb.project_remove("beside", project=cell)
    alone = solve_project(cell, command="solve")
    assert set(alone.results["scan"].cameras) == {"left", "light"}
    assert [s.of for s in alone.made] == ["cell"]
