"""`calibrant verify stitch`: what is missing is said, and depth files are put together."""

from __future__ import annotations

import contextlib
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.verification.stitch.test_clouds import CAMERA, X, depth, gripper

import calibrant as cb
from calibrant.cli.application import run
from calibrant.data import RobotPoses
from calibrant.data.details import TaskRuns
from calibrant.geometry import se3
from calibrant.simulate.cell import poses_csv
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.scenes import gripper_poses, look_at_board, observe
from calibrant.targets.registry import parse_target

BOARD = parse_target("chessboard:7x6:30mm")
READ = ("--pose-rotation", "quat-xyzw", "--pose-direction", "base-gripper", "--pose-units", "m")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out, rng = tmp_path_factory.mktemp("stitch"), np.random.default_rng(4)
    T = look_at_board(CAMERA, BOARD.points, 16, rng=rng, distance=(0.35, 0.5), tilt_deg=40, roll_deg=40)
    Z = se3.make(np.diag([1.0, -1.0, -1.0]), [0.5, 0.0, 0.0])
    said = noisy_poses(gripper_poses("eye-in-hand", X, Z, T), sigma_mm=0.05, sigma_deg=0.01, rng=rng)
    seen = replace(observe(CAMERA, BOARD.points, T, sigma_px=0.03, rng=rng), target=BOARD.spec)
    cb.calibrate_hand_eye(RobotPoses.from_matrices(said), seen, setup="eye-in-hand").write(out / "hand-eye.json")
    at = np.stack([gripper(k) for k in range(4)])
    (out / "poses.csv").write_text(poses_csv(RobotPoses.from_matrices(at, ids=[f"{k}.npy" for k in range(4)])))
    for k, A in enumerate(at):
        np.save(out / f"{k}.npy", depth(A @ X, rng))
    return out


def said(*arguments: str | Path) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = run(["verify", "stitch", *map(str, arguments)])
    return status, " ".join(out.getvalue().split()), err.getvalue()


def test_depth_files_are_put_together(folder: Path, tmp_path: Path) -> None:
    given = (folder / "hand-eye.json", "--poses", folder / "poses.csv", *READ, "--tolerance", "3mm")
    depths = [w for k in range(4) for w in ("--depth", folder / f"{k}.npy")]
    status, out, err = said(*given, *depths, "--out", tmp_path / "stitch.json")
    assert status == 0, err
    assert "mm are predicted" in out
    record = cb.read(tmp_path / "stitch.json").detail(TaskRuns)
    assert record is not None
    assert len(record.runs) == 6
    status, _, err = said(*given, *depths[:6])
    assert status == 2
    assert "3 depth pictures and 4 poses" in err


def test_what_is_missing_is_said(folder: Path) -> None:
    assert "--cell" in said()[2]
    assert "--depth" in said(folder / "hand-eye.json", "--poses", folder / "poses.csv")[2]
    assert "--view wrist" in said("--cell", "--view", "top", "--seeds", "1")[2]
