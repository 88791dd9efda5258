"""`calibrant verify unchanged`: from files to an answer, an exit status and pictures."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import calibrant as cb
from calibrant.cameras import Camera
from calibrant.cli.application import run
from calibrant.data import CalibrationResult, Observations, RobotPoses
from calibrant.data.details import Changes, ReferencePicture
from calibrant.data.result_file import result_text
from calibrant.geometry import se3, so3
from calibrant.simulate.cell import poses_csv
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import gripper_poses, look_at_board, observe, standard_mounting
from calibrant.simulate.wall import photograph_wall, wall
from calibrant.targets.registry import parse_target

TARGET = parse_target("chessboard:7x6:30mm")
CAMERA = Camera.create("pinhole", {"fx": 430.0, "fy": 430.0, "cx": 239.5, "cy": 179.5}, image_size=(480, 360))
VIEWS = 16
PUSH = se3.make(so3.exp([0.0, 0.01, 0.0]), [0.004, 0.0, 0.0])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hand-eye result, photos of now as they should be and of a pushed camera, their poses; pictures of a wall."""
    out = tmp_path_factory.mktemp("verify")
    rng = np.random.default_rng(4)
    T = look_at_board(CAMERA, TARGET.points, VIEWS + 2, rng=rng, distance=(0.35, 0.6), tilt_deg=40, roll_deg=20)
    X, Z = standard_mounting("eye-in-hand")
    said = noisy_poses(gripper_poses("eye-in-hand", X, Z, T), sigma_mm=0.05, sigma_deg=0.01, rng=rng)
    seen = observe(CAMERA, TARGET.points, T[:VIEWS], sigma_px=0.05, rng=rng)
    seen = replace(seen, target=TARGET.spec)
    poses = RobotPoses.from_matrices(said[:VIEWS])
    cb.calibrate_hand_eye(poses, seen, setup="eye-in-hand").write(out / "hand-eye.json")
    names = [f"{i}.png" for i in range(2)]
    (out / "now.csv").write_text(poses_csv(RobotPoses.from_matrices(said[VIEWS:], ids=names)))
    for kind, D in (("same", np.eye(4)), ("pushed", PUSH)):
        (out / kind).mkdir()
        for name, pose in zip(names, T[VIEWS:]):
            image = render(
                TARGET.artwork(), CAMERA, se3.inverse(D) @ pose, rng=rng, look=Look(clutter=0, noise_grey=2.0)
            )
            cv2.imwrite(str(out / kind / name), image)
    scene = wall(CAMERA, rng=rng)
    turned = se3.make(so3.exp([0.0, 0.012, 0.0]), np.zeros(3))
    for name, D in (("then", np.eye(4)), ("still", np.eye(4)), ("turned", turned)):
        cv2.imwrite(str(out / f"{name}.png"), photograph_wall(scene, CAMERA, D, rng=rng))
    cv2.imwrite(str(out / "grey.png"), np.random.default_rng(0).integers(100, 104, (360, 480)).astype(np.uint8))
    CalibrationResult("intrinsics", "ok", cameras={"camera": CAMERA}).write(out / "camera.json")
    return out


def said(*arguments: str | Path) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = run(["verify", "unchanged", *map(str, arguments)])
    return status, " ".join(out.getvalue().split()), err.getvalue()


def test_photos_at_robot_poses(folder: Path, tmp_path: Path) -> None:
    options = ("--poses", folder / "now.csv", "--report", tmp_path / "page.html", "--overlay", tmp_path / "back.png")
    status, out, _ = said(folder / "hand-eye.json", "--images", folder / "same", "--poses", folder / "now.csv")
    assert status == 0
    assert "Unchanged: 2 photos show the target where the calibration puts it" in out
    status, out, err = said(folder / "hand-eye.json", "--images", folder / "pushed", *options)
    assert status == 1
    assert "Changed: the camera moved" in out
    assert "mm to the right" in out
    assert "Push the camera back" in out
    assert err.strip().splitlines()[-1].startswith("calibrant: changed: the camera")
    page = (tmp_path / "page.html").read_text()
    assert "CHANGED" in page
    assert "What to do" in page
    assert page.count('class="shifts"') == 2
    assert "data:image/jpeg" in page
    drawn = cv2.imread(str(tmp_path / "back.png"))
    assert drawn is not None
    assert drawn.shape == (360, 480, 3)


def test_photos_of_one_name_go_with_the_poses_of_their_folders(folder: Path, tmp_path: Path) -> None:
    header, *rows = (folder / "now.csv").read_text().splitlines()
    places = [tmp_path / "a" / "0.png", tmp_path / "b" / "0.png"]
    for k, place in enumerate(places):
        place.parent.mkdir()
        shutil.copy(folder / "same" / f"{k}.png", place)
    # The second folder's pose stands first: by bare names nothing tells which photo it is of.
    named = [rows[1].replace("1.png", "b/0.png"), rows[0].replace("0.png", "a/0.png")]
    (tmp_path / "now.csv").write_text("\n".join([header, *named, ""]))
    images = [str(p) for p in places]
    result = cb.verify_unchanged(folder / "hand-eye.json", images=images, poses=tmp_path / "now.csv")
    assert result.check("unchanged").status == "ok"
    assert {v.id for v in result.views} == {"a/0.png", "b/0.png"}
    # Without names, the pose of a photo that is left out goes with it.
    unnamed = [row.partition(",")[2] for row in (header, *rows)]
    (tmp_path / "order.csv").write_text("\n".join([*unnamed, ""]))
    result = cb.verify_unchanged(
        folder / "hand-eye.json", images=images, poses=tmp_path / "order.csv", exclude="a/0.png"
    )
    assert result.check("unchanged").status == "ok"
    assert {v.id for v in result.views if v.used} == {"0.png"}


def test_from_python_a_change_is_a_result(folder: Path) -> None:
    result = cb.verify_unchanged(folder / "hand-eye.json", images=folder / "pushed", poses=folder / "now.csv")
    assert result.verdict == "refused"
    assert result.check("unchanged").status == "fail"
    changes = result.detail(Changes)
    assert changes is not None
    assert changes.possible[0].what == "camera"
    moved, sigma = changes.possible[0].moved_mm, changes.possible[0].moved_sigma_mm
    assert moved is not None
    assert sigma is not None
    assert abs(moved[0] - 4) < 5 * sigma[0]
    assert "CHANGED" in str(result)
    assert json.loads(result_text(result))["kind"] == "unchanged"


def test_a_reference_picture_needs_no_target(folder: Path, tmp_path: Path) -> None:
    then = ("--reference", folder / "then.png")
    status, out, _ = said(folder / "camera.json", "--images", folder / "still.png", *then)
    assert status == 0
    assert "the picture is where it was" in out
    status, out, _ = said(
        folder / "camera.json", "--images", folder / "turned.png", *then, "--overlay", tmp_path / "o.png"
    )
    assert status == 1
    assert "px to the left" in out
    assert "turned 0.6" in out
    assert "deg to the right" in out
    assert (tmp_path / "o.png").stat().st_size > 1000
    status, _, err = said(folder / "camera.json", "--images", folder / "grey.png", *then)
    assert status == 2
    assert "texture" in err


def test_a_reference_is_kept_in_the_result(folder: Path, tmp_path: Path) -> None:
    kept = tmp_path / "kept.json"
    status, out, _ = said(folder / "hand-eye.json", "--images", folder / "then.png", "--keep-reference", kept)
    assert status == 0
    assert "Kept then.png as the reference" in out
    record = cb.read(kept).detail(ReferencePicture)
    assert record is not None
    assert record.image_size == (480, 360)
    assert len(record.jpeg) < 100_000
    status, out, _ = said(kept, "--images", folder / "turned.png")
    assert status == 1
    assert "mm at the workpiece" in out


def test_a_target_that_stands_beside_a_pose_result(folder: Path, tmp_path: Path) -> None:
    found = cb.pose(folder / "same" / "0.png", camera=folder / "camera.json", target=TARGET.spec)
    found.write(tmp_path / "pose.json")
    status, out, _ = said(tmp_path / "pose.json", "--images", folder / "same" / "0.png")
    assert status == 0
    status, out, _ = said(tmp_path / "pose.json", "--images", folder / "pushed" / "0.png")
    assert status == 1
    assert "not told apart by the target alone" in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("hand-eye.json", "--images", "same"), "give those of the photos"),
        (("camera.json", "--images", "same"), "does not name its target"),
        (("camera.json",), "no photos were given"),
        (("camera.json", "--images", "then.png", "--target", TARGET.spec), "0 of 1 boards found"),
        (("camera.json", "--images", "same", "--poses", "now.csv", "--target", TARGET.spec), "goes with a hand-eye"),
        (("camera.json", "--images", "then.png", "--reference", "then.png"), "give another photo"),
        (("camera.json", "--images", "then.png", "--name", "left"), "no such camera"),
        (("camera.json", "--images", "then.png", "--reference", "still.png", "--tolerance", "2"), "no unit"),
    ],
)
def test_what_cannot_be_compared_has_status_2(
    folder: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], words: str
) -> None:
    monkeypatch.chdir(folder)
    status, _, err = said(*arguments)
    assert status == 2, err
    assert words in err


def test_another_resolution_is_refused(folder: Path, tmp_path: Path) -> None:
    image = cv2.imread(str(folder / "same" / "0.png"))
    cv2.imwrite(str(tmp_path / "0.png"), cv2.resize(image, (960, 720)))
    status, _, err = said(folder / "camera.json", "--images", tmp_path / "0.png", "--target", TARGET.spec)
    assert status == 2
    assert "in the resolution of the calibration" in err


def test_a_result_without_a_camera_is_refused(folder: Path, tmp_path: Path) -> None:
    nothing = CalibrationResult("tool", "ok", observations=Observations((), {}))
    nothing.write(tmp_path / "tool.json")
    status, _, err = said(tmp_path / "tool.json", "--images", folder / "then.png")
    assert status == 2
    assert "holds no camera" in err
