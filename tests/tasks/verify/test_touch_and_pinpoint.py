"""`calibrant verify touch` and `verify pinpoint`: from photos and what was read to an answer and an exit status."""

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
from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.cli.application import run
from calibrant.data import RobotPoses
from calibrant.data.details import TaskRuns
from calibrant.geometry import se3, so3
from calibrant.simulate.cell import poses_csv
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import gripper_poses, look_at_board, observe, standard_mounting
from calibrant.targets.registry import parse_target

TARGET = parse_target("chessboard:7x6:30mm")
CAMERA = Camera.create("pinhole", {"fx": 430.0, "fy": 430.0, "cx": 239.5, "cy": 179.5}, image_size=(480, 360))
VIEWS, NOW = 16, 4
TIP = np.array([0.0, 0.0, 0.12])
X, Z = standard_mounting("eye-in-hand")
MIDDLE = 0.5 * (TARGET.points.min(axis=0) + TARGET.points.max(axis=0))


def touching(point: Array, rng: np.random.Generator) -> Array:
    """T_base_gripper with the tip at a point of the target."""
    R = Z[:3, :3] @ so3.exp([np.pi, 0, 0]) @ so3.exp(0.3 * rng.uniform(-1, 1, 3))
    return se3.make(R, se3.apply(Z, point) - R @ TIP)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hand-eye result written from files, four photos of the board at robot poses, and touches of its middle."""
    out = tmp_path_factory.mktemp("touch")
    rng = np.random.default_rng(4)
    T = look_at_board(CAMERA, TARGET.points, VIEWS + NOW, rng=rng, distance=(0.35, 0.6), tilt_deg=40, roll_deg=20)
    said = noisy_poses(gripper_poses("eye-in-hand", X, Z, T), sigma_mm=0.05, sigma_deg=0.01, rng=rng)
    seen = replace(observe(CAMERA, TARGET.points, T[:VIEWS], sigma_px=0.05, rng=rng), target=TARGET.spec)
    ids = [v.id for v in seen.views]
    (out / "then.csv").write_text(poses_csv(RobotPoses.from_matrices(said[:VIEWS], ids=ids)))
    poses = cb.RobotPoses.from_matrices(said[:VIEWS], ids=ids)
    found = cb.calibrate_hand_eye(poses, seen, setup="eye-in-hand")
    found.write(out / "hand-eye.json")
    names = [f"{i}.png" for i in range(NOW)]
    (out / "now.csv").write_text(poses_csv(RobotPoses.from_matrices(said[VIEWS:], ids=names)))
    (out / "now").mkdir()
    for name, pose in zip(names, T[VIEWS:]):
        image = render(TARGET.artwork(), CAMERA, pose, rng=rng, look=Look(clutter=0, noise_grey=2.0))
        cv2.imwrite(str(out / "now" / name), image)
    touches = np.stack([touching(MIDDLE, rng) for _ in range(NOW)])
    (out / "touches.csv").write_text(poses_csv(RobotPoses.from_matrices(touches, ids=names)))
    touches[:, 0, 3] += 0.004
    (out / "off.csv").write_text(poses_csv(RobotPoses.from_matrices(touches, ids=names)))
    (out / "read.csv").write_text("image,dx_mm,dy_mm,dz_mm\n" + "\n".join(f"{n},0.2,-0.1,0.1" for n in names))
    return out


READ = ("--pose-rotation", "quat-xyzw", "--pose-direction", "base-gripper", "--pose-units", "m")


def said(command: str, folder: Path, *arguments: str | Path) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    given = (folder / "hand-eye.json", "--images", folder / "now", "--poses", folder / "now.csv", "--tip", "0,0,120mm")
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = run(["verify", command, *map(str, (*given, *READ, *arguments))])
    return status, " ".join(out.getvalue().split()), err.getvalue()


@pytest.mark.long
def test_touches_where_the_camera_says_pass(folder: Path, tmp_path: Path) -> None:
    page, kept = tmp_path / "page.html", tmp_path / "touch.json"
    options = ("--touches", folder / "touches.csv", "--tolerance", "2mm", "--report", page, "--out", kept)
    status, out, err = said("touch", folder, *options)
    assert status == 0, err
    assert "4 of 4 passed, each within 2 mm" in out
    record = cb.read(kept).detail(TaskRuns)
    assert record is not None
    assert all(r.error_mm is not None and r.error_mm < 1.5 and r.inside for r in record.runs)
    assert "Run by run" in page.read_text()


@pytest.mark.long
def test_touches_that_are_off_fail_with_the_offset(folder: Path) -> None:
    status, out, err = said("touch", folder, "--touches", folder / "off.csv", "--tolerance", "2mm", "--json")
    assert status == 1
    found = json.loads(out)
    assert found["figures"]["offset x"]["value"] == pytest.approx(-4.0, abs=0.8)
    assert "more than the tolerance of 2 mm" in err
    assert "4 of 4 failed" in err


@pytest.mark.long
def test_a_pinpoint_says_where_to_go_and_what_was_read(folder: Path) -> None:
    status, out, _ = said("pinpoint", folder)
    assert status == 0
    assert "4 places to go to" in out
    assert "Nothing has moved" in out
    assert "flange to x, y, z" in out
    status, out, err = said("pinpoint", folder, "--offsets", folder / "read.csv", "--tolerance", "1mm")
    assert status == 0, err
    assert "4 of 4 passed" in out
    assert "move camera camera in the gripper by" in out
    status, out, _ = said("pinpoint", folder, "--tolerance", "0.01mm")
    assert "cannot be met" in out


@pytest.mark.parametrize(
    ("command", "options", "message"),
    [
        ("touch", (), "--touches FILE"),
        ("pinpoint", ("--tip", "120mm"), "give x,y,z of the tip"),
        ("pinpoint", ("--tip", "0,0,120"), "unit"),
        ("pinpoint", ("--table", "0mm,1mm,2mm"), "height of the table"),
    ],
)
def test_what_cannot_be_meant_is_said(folder: Path, command: str, options: tuple[str, ...], message: str) -> None:
    status, _, err = said(command, folder, *options)
    assert status == 2
    assert message in err


def test_a_calibration_without_the_transform_is_said(folder: Path, tmp_path: Path) -> None:
    lens = cb.CalibrationResult("intrinsics", "ok", cameras={"camera": CAMERA}).write(tmp_path / "lens.json")
    err = io.StringIO()
    with contextlib.redirect_stderr(err):
        status = run(["verify", "pinpoint", str(lens), "--images", str(folder / "now"), "--tip", "0,0,120mm"])
    assert status == 2
    assert "give a result of `calibrant hand-eye`" in err.getvalue()


@pytest.mark.long
def test_fresh_views_are_as_far_off_as_predicted(folder: Path, tmp_path: Path) -> None:
    out, err = io.StringIO(), io.StringIO()
    given = ("verify", "held-out", folder / "hand-eye.json", "--images", folder / "now", "--poses", folder / "now.csv")
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = run([*map(str, (*given, *READ, "--tolerance", "1mm", "--out", tmp_path / "held.json"))])
    assert status == 0, err.getvalue()
    found = cb.read(tmp_path / "held.json")
    record = found.detail(TaskRuns)
    assert record is not None
    assert all(r.inside for r in record.runs)
    assert found.held_out is not None
    assert found.held_out.mm is not None
    assert found.held_out.mm < 0.6
    assert found.check("chi-square").status == "ok"
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        assert run([*map(str, (*given, *READ, "--tolerance", "0.01px"))]) == 1
    assert "more than the tolerance of 0.01 px" in err.getvalue()
