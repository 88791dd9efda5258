"""`calibrant verify watch`: from files to an answer, an exit status and a page."""

from __future__ import annotations

import contextlib
import io
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import calibrant as cb
from calibrant.cameras import Camera
from calibrant.cli.application import run
from calibrant.data import CalibrationResult, RobotPoses, as_transform
from calibrant.data.details import Watching
from calibrant.geometry import se3, so3
from calibrant.simulate.cell import poses_csv
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import gripper_poses, look_at_board, observe, standard_mounting
from calibrant.targets.registry import parse_target

TARGET = parse_target("chessboard:7x6:30mm")
CAMERA = Camera.create("pinhole", {"fx": 430.0, "fy": 430.0, "cx": 239.5, "cy": 179.5}, image_size=(480, 360))
VIEWS, NOW, AT = 16, 9, 4
PUSH = se3.make(np.eye(3), [0.003, 0.0, 0.0])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hand-eye result and pictures of now, pushed from the fifth on; dots on a gripper, pushed from the fifth on."""
    out = tmp_path_factory.mktemp("watch")
    rng = np.random.default_rng(4)
    T = look_at_board(CAMERA, TARGET.points, VIEWS + NOW, rng=rng, distance=(0.35, 0.6), tilt_deg=40, roll_deg=20)
    X, Z = standard_mounting("eye-in-hand")
    said = noisy_poses(gripper_poses("eye-in-hand", X, Z, T), sigma_mm=0.05, sigma_deg=0.01, rng=rng)
    seen = replace(observe(CAMERA, TARGET.points, T[:VIEWS], sigma_px=0.05, rng=rng), target=TARGET.spec)
    cb.calibrate_hand_eye(RobotPoses.from_matrices(said[:VIEWS]), seen, setup="eye-in-hand").write(
        out / "hand-eye.json"
    )
    names = [f"{i}.png" for i in range(NOW)]
    (out / "now.csv").write_text(poses_csv(RobotPoses.from_matrices(said[VIEWS:], ids=names)))
    (out / "now").mkdir()
    for i, (name, pose) in enumerate(zip(names, T[VIEWS:])):
        moved = se3.inverse(PUSH) @ pose if i >= AT else pose
        image = render(TARGET.artwork(), CAMERA, moved, rng=rng, look=Look(clutter=0, noise_grey=2.0))
        cv2.imwrite(str(out / "now" / name), image)
    (out / "dots").mkdir()
    for i in range(12):
        grey = np.full((360, 480), 170, np.uint8)
        for u in (180, 300):
            cv2.circle(grey, (u + 2 * (i >= AT), 250), 5, 30, -1)
        cv2.imwrite(str(out / "dots" / f"{i:02d}.png"), cv2.GaussianBlur(grey, (0, 0), 0.8))
    (out / "features.csv").write_text("u,v,x_mm,y_mm,z_mm\n180,250,-20,0,0\n300,250,20,0,0\n")
    place = as_transform("gripper", "camera", se3.make(so3.exp([0.0, 0.0, 0.0]), [0.0, -0.05, -0.2]))
    CalibrationResult("self-visibility", "ok", cameras={"camera": CAMERA}, transforms=(place,)).write(out / "hand.json")
    return out


def said(*arguments: str | Path) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = run(["verify", "watch", *map(str, arguments)])
    return status, " ".join(out.getvalue().split()), err.getvalue()


@pytest.mark.long
def test_a_pushed_hand_camera_is_named_with_its_picture(folder: Path, tmp_path: Path) -> None:
    options = ("--poses", folder / "now.csv", "--report", tmp_path / "page.html", "--out", tmp_path / "watch.json")
    status, out, err = said(folder / "hand-eye.json", "--images", folder / "now", *options)
    assert status == 1, err
    assert "Moved since 4.png" in out
    assert "the camera moved" in out
    found = cb.read(tmp_path / "watch.json")
    record = found.detail(Watching)
    assert record is not None
    assert record.since == "4.png"
    assert found.figures["moved x"].value == pytest.approx(3.0, abs=4 * found.figures["moved x"].sigma)
    page = (tmp_path / "page.html").read_text()
    assert "Picture by picture" in page
    assert "first after the move" in page


def test_pushed_features_of_a_gripper(folder: Path) -> None:
    status, out, _ = said(folder / "hand.json", "--images", folder / "dots", "--features", folder / "features.csv")
    assert status == 1
    assert "Moved since 04.png" in out
    assert "2.0" in out
    assert "do not tell a shift of the camera from a turn" in out


def test_features_that_stay_are_not_moved(folder: Path) -> None:
    first = [folder / "dots" / f"{i:02d}.png" for i in range(AT)]
    options = ("--features", folder / "features.csv", "--json")
    status, out, err = said(folder / "hand.json", *(w for f in first for w in ("--images", f)), *options)
    assert status == 0, err
    assert json.loads(out)["kind"] == "watch"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--run", "1"), "100 or more"),
        (("--poses", "now.csv"), "leave --poses out"),
        (("--sigma-px", "3"), "px"),
    ],
)
def test_what_cannot_be_meant_is_said(folder: Path, options: tuple[str, str], message: str) -> None:
    option, value = options
    given = (option, folder / value if option == "--poses" else value)
    status, _, err = said(
        folder / "hand.json", "--images", folder / "dots", "--features", folder / "features.csv", *given
    )
    assert status == 2
    assert message in err


def test_pictures_without_the_features_are_said(folder: Path) -> None:
    status, _, err = said(folder / "hand.json", "--images", folder / "now", "--features", folder / "features.csv")
    assert status in (1, 2)
    assert "feature" in err
