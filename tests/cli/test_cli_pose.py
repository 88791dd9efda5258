"""calibrant pose, and own points in the commands that take a target: from files to results and pictures."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant.calibrate.pose.estimate import SECOND
from calibrant.cameras import Camera
from calibrant.cli.application import run
from calibrant.data import CalibrationResult, RobotPoses
from calibrant.data.result_file import read_result
from calibrant.formats.documents.opencv_storage import yaml_text
from calibrant.geometry import se3, so3
from calibrant.simulate.cell import poses_csv
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import gripper_poses, look_at_board, standard_camera, standard_mounting
from calibrant.targets.registry import parse_target

Array = NDArray[np.float64]
TARGET = "chessboard:7x5:25mm"
CAMERA = standard_camera()
SIGMA = np.array([1.0, 1.0, 1.5, 1.5, 1e-3, 2e-3, 1e-4, 1e-4, 1e-3])


@pytest.fixture(scope="module", name="photos")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Array]:
    """Two photos of a board, camera.json with its uncertainty, and the true poses (2, 4, 4)."""
    folder, rng = tmp_path_factory.mktemp("pose"), np.random.default_rng(0)
    board = parse_target(TARGET)
    T = look_at_board(CAMERA, board.points, 2, rng=rng, distance=(0.4, 0.5), roll_deg=30)
    for i, pose in enumerate(T):
        image = render(board.artwork(), CAMERA, pose, rng=rng, look=Look(noise_grey=2.0, clutter=20))
        cv2.imwrite(str(folder / f"{i}.png"), image)
    known = replace(CAMERA, covariance=np.diag(SIGMA**2))
    CalibrationResult("intrinsics", "ok", cameras={"camera": known}).write(folder / "camera.json")
    return folder, T


def own_points(folder: Path, camera: Camera, points: Array, T: Array, *, sigma_px: float) -> list[str]:
    """Grey photos NN.png and their points NN.yml, as 3D-EasyCalib wants them: obj in millimetres."""
    rng = np.random.default_rng(1)
    folder.mkdir()
    width, height = camera.image_size
    photos = []
    for i, pose in enumerate(T):
        uv = camera.project(se3.apply(pose, points)) + sigma_px * rng.standard_normal((len(points), 2))
        (folder / f"{i}.yml").write_text(yaml_text({"corners": uv, "obj": 1e3 * points}))
        cv2.imwrite(str(folder / f"{i}.png"), np.full((height, width), 128, np.uint8))
        photos.append(str(folder / f"{i}.png"))
    return photos


def block() -> Array:
    return np.random.default_rng(0).uniform((0, 0, -0.05), (0.2, 0.15, 0.05), size=(40, 3))


def test_poses_of_photos_with_pictures(
    photos: tuple[Path, Array], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, T = photos
    names = [str(folder / "0.png"), str(folder / "1.png")]
    out, seen = tmp_path / "pose.json", tmp_path / "seen"
    arguments = ["--camera", str(folder / "camera.json"), "--target", TARGET]
    report = tmp_path / "pose.html"
    assert run(["pose", *names, *arguments, "--out", str(out), "--overlay", str(seen), "--report", str(report)]) == 0
    printed = capsys.readouterr().out
    assert "Target pose" in printed
    assert "line of sight" in " ".join(printed.split())
    result = read_result(out)
    for i, pose in enumerate(T):
        estimate = result.transform("camera", f"target@{i}.png")
        error = se3.local(estimate.matrix, pose)
        # The camera's uncertainty is stated far larger than its error here, which is none.
        assert np.all(np.abs(error) < 3 * np.sqrt(np.diag(estimate.covariance)))  # type: ignore[arg-type]
        picture = cv2.imread(str(seen / f"{i}-seen.png"))
        assert picture is not None
        assert picture.shape[:2] == (1024, 1280)
    assert result.check("camera").status == "ok"
    assert {Path(f["file"]).name for f in result.inputs} == {"0.png", "1.png", "camera.json"}


def test_one_photo_as_json_and_the_mirrored_solution(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    points = np.array([[0, 0, 0], [0.03, 0, 0], [0, 0.03, 0], [0.03, 0.03, 0]])
    T = se3.make(so3.exp([0.4, 0, 0]), [0.02, -0.01, 1.5])[None]
    photos = own_points(tmp_path / "own", CAMERA, points, T, sigma_px=0.3)
    CalibrationResult("intrinsics", "ok", cameras={"camera": CAMERA}).write(tmp_path / "camera.json")
    arguments = ["--camera", str(tmp_path / "camera.json"), "--target", f"points:{tmp_path / 'own'}"]
    picture = tmp_path / "seen.png"
    status = run(["pose", *photos, *arguments, "--sigma-px", "0.3px", "--json", "--overlay", str(picture)])
    assert status == 0
    answer = json.loads(capsys.readouterr().out)
    assert [t["child"] for t in answer["transforms"]] == ["target", "target" + SECOND]
    assert answer["verdict"] == "warn"
    assert picture.exists()


def test_own_points_of_a_target_with_depth_in_every_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """intrinsics without a start value, hand-eye, pose and detect."""
    X, Z = standard_mounting("eye-in-hand")
    T = look_at_board(CAMERA, block(), 10, rng=np.random.default_rng(3), distance=(0.4, 0.6))
    photos = own_points(tmp_path / "own", CAMERA, block(), T, sigma_px=0.05)
    target = ["--target", f"points:{tmp_path / 'own'}"]
    camera, hand_eye, found = (tmp_path / n for n in ("camera.json", "hand-eye.json", "found.json"))
    assert run(["intrinsics", *photos, *target, "--out", str(camera), "--quiet"]) == 0
    known = read_result(camera)
    z = (known.camera.values - CAMERA.values) / np.array(list(known.camera.sigma.values()))
    assert np.all(np.abs(z) < 4)
    assert any(f["file"].endswith("0.yml") for f in known.inputs)

    robot = RobotPoses.from_matrices(gripper_poses("eye-in-hand", X, Z, T), ids=[Path(p).name for p in photos])
    (tmp_path / "poses.csv").write_text(poses_csv(robot))
    status = run(
        ["hand-eye", "--images", *photos, *target, "--poses", str(tmp_path / "poses.csv"), "--camera", str(camera),
         "--out", str(hand_eye), "--quiet"]
    )  # fmt: skip
    assert status == 0
    # 0.05 px of noise over 0.5 m: a few hundredths of a millimetre.
    np.testing.assert_allclose(read_result(hand_eye).transform("gripper", "camera").matrix, X, atol=1e-3)

    assert run(["pose", *photos[:2], *target, "--camera", str(camera), "--out", str(tmp_path / "p.json"), "-q"]) == 0
    pose = read_result(tmp_path / "p.json").transform("camera", "target@1.png")
    np.testing.assert_allclose(pose.matrix, T[1], atol=1e-3)

    capsys.readouterr()
    overlays = tmp_path / "overlays"
    assert run(["detect", *photos[:3], *target, "--out", str(found), "--overlays", str(overlays)]) == 0
    assert "40 of 40" in capsys.readouterr().out
    assert len(list(overlays.iterdir())) == 3
    assert run(["intrinsics", "--observations", str(found), "--quiet"]) == 0


def test_own_points_of_a_flat_target(tmp_path: Path) -> None:
    points = parse_target("chessboard:7x5:30mm").points
    T = look_at_board(CAMERA, points, 12, rng=np.random.default_rng(4), distance=(0.3, 0.6))
    photos = own_points(tmp_path / "own", CAMERA, points, T, sigma_px=0.1)
    out = tmp_path / "camera.json"
    assert run(["intrinsics", *photos, "--target", f"points:{tmp_path / 'own'}", "--out", str(out), "--quiet"]) == 0
    camera = read_result(out).camera
    assert abs(camera.parameters["fx"] - CAMERA.parameters["fx"]) < 4 * camera.sigma["fx"]


def test_what_cannot_be_used_has_status_2(
    photos: tuple[Path, Array], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = photos
    photo, camera = str(folder / "0.png"), ["--camera", str(folder / "camera.json")]
    folder_of_points = tmp_path / "own"
    ahead = se3.make(np.eye(3), [0.0, 0.0, 0.6])[None]
    few = own_points(folder_of_points, CAMERA, block()[:5], ahead, sigma_px=0.0)
    cases = {
        "a pose needs the camera": ["pose", photo, "--target", TARGET],
        "--sigma-px takes a length": ["pose", photo, *camera, "--target", TARGET, "--sigma-px", "1"],
        "expected the name of a picture": [
            "pose",
            photo,
            *camera,
            "--target",
            TARGET,
            "--overlay",
            str(tmp_path / "x"),
        ],
        "is an input of this command": ["pose", photo, *camera, "--target", TARGET, "--overlay", photo, "--force"],
        "own points are taken as they are": [
            "pose",
            *few,
            *camera,
            "--target",
            f"points:{folder_of_points}",
            "--mirror-x",
        ],
        "there is no 0.yml": ["pose", photo, *camera, "--target", f"points:{tmp_path}"],
    }
    for said, arguments in cases.items():
        assert run(arguments) == 2, arguments
        assert said in capsys.readouterr().err


def test_a_target_with_depth_says_that_it_needs_a_start(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    T = look_at_board(CAMERA, block(), 6, rng=np.random.default_rng(3), distance=(0.4, 0.6))
    photos = own_points(tmp_path / "own", CAMERA, block()[:5], T, sigma_px=0.05)
    assert run(["intrinsics", *photos, "--target", f"points:{tmp_path / 'own'}", "--model", "pinhole"]) == 2
    assert "give --initial camera.json" in capsys.readouterr().err
