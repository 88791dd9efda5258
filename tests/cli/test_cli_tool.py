"""calibrant tool: touch, seen and self-visibility, from files to a result."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant.cli.application import run
from calibrant.data import CalibrationResult, RobotPoses, as_transform
from calibrant.data.result_file import read_result
from calibrant.geometry import se3, so3
from calibrant.simulate.cell import poses_csv
from calibrant.simulate.render import render
from calibrant.simulate.scenes import standard_camera
from calibrant.simulate.truth import normalised
from calibrant.targets.registry import parse_target

Array = NDArray[np.float64]
TIP = np.array([0.012, -0.034, 0.151])
DOWN = so3.exp([np.pi, 0, 0])


def poses_file(T: Array, path: Path) -> Path:
    path.write_text(poses_csv(RobotPoses.from_matrices(T, ids=[f"{i}.png" for i in range(len(T))])))
    return path


def test_touch(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(0)
    R = DOWN @ so3.exp(0.5 * rng.uniform(-1, 1, (6, 3)))
    T = se3.make(R, np.array([0.5, 0.1, 0.05]) - R @ TIP)
    T[:, :3, 3] += 1e-4 * rng.standard_normal((6, 3))
    out = tmp_path / "tool.json"
    assert run(["tool", "touch", "--poses", str(poses_file(T, tmp_path / "p.csv")), "--out", str(out)]) == 0
    assert "Tool calibration" in capsys.readouterr().out
    estimate = read_result(out).transform("flange", "tip")
    sigma = estimate.sigma_translation_mm
    assert sigma is not None
    assert np.all(np.abs(1e3 * (estimate.matrix[:3, 3] - TIP)) < 4 * sigma)
    assert run(["tool", "touch", "--poses", str(poses_file(T[:3], tmp_path / "few.csv"))]) == 2
    assert "at least 4" in capsys.readouterr().err


@pytest.mark.parametrize(("off", "status", "words"), [(0.005, 0, "USE WITH CARE"), (0.15, 1, "agreement: the poses")])
def test_poses_that_touch_no_point_are_no_tool(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], off: float, status: int, words: str
) -> None:
    rng = np.random.default_rng(4)
    R = DOWN @ so3.exp(0.5 * rng.uniform(-1, 1, (12, 3)))
    T = se3.make(R, np.array([0.5, 0.1, 0.05]) - R @ TIP + off * rng.standard_normal((12, 3)))
    given = ["--poses", str(poses_file(T, tmp_path / "p.csv")), "--pose-rotation", "quat-xyzw", "--pose-units", "m"]
    assert run(["tool", "touch", *given]) == status
    said = capsys.readouterr()
    assert words in " ".join((said.out + said.err).split())
    assert "are these the poses of the touches" in " ".join((said.out + said.err).split())


def test_a_slipped_touch_is_named_and_little_tilt_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(3)
    for tilt, slip, message in ((0.5, 0.003, "2.png is off by"), (0.02, 0.0, "tilt the tool further")):
        R = DOWN @ so3.exp(tilt * rng.uniform(-1, 1, (8, 3)))
        T = se3.make(R, np.array([0.5, 0.1, 0.05]) - R @ TIP)
        T[:, :3, 3] += 1e-4 * rng.standard_normal((8, 3))
        T[2, 0, 3] += slip
        assert run(["tool", "touch", "--poses", str(poses_file(T, tmp_path / f"{tilt}.csv"))]) == 0
        text = " ".join(capsys.readouterr().out.split())
        assert message in text
        assert "USE WITH CARE" in text
        assert "yaw" not in text


def test_touches_in_millimetres_and_euler_angles_are_understood(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    R = DOWN @ so3.exp(0.5 * rng.uniform(-1, 1, (8, 3)))
    T = se3.make(R, np.array([0.5, 0.1, 0.05]) - R @ TIP)
    T[:, :3, 3] += 1e-4 * rng.standard_normal((8, 3))
    lines = ["x,y,z,rx,ry,rz"]
    for pose in T:
        lines.append(",".join(f"{v:.6f}" for v in (*(1e3 * pose[:3, 3]), *so3.log(pose[:3, :3]))))
    (tmp_path / "p.csv").write_text("\n".join(lines))
    out = tmp_path / "tool.json"
    assert run(["tool", "touch", "--poses", str(tmp_path / "p.csv"), "--out", str(out), "--quiet"]) == 0
    # 0.1 mm of touch noise over 0.15 m of lever: well within a millimetre.
    np.testing.assert_allclose(read_result(out).transform("flange", "tip").matrix[:3, 3], TIP, atol=1e-3)


def test_seen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng, camera = np.random.default_rng(2), standard_camera()
    X = se3.make(DOWN, [0.5, 0.0, 1.0])
    R = DOWN @ so3.exp(0.7 * rng.uniform(-1, 1, (5, 3)))
    T = se3.make(R, rng.uniform((0.35, -0.15, 0.25), (0.65, 0.15, 0.45), (5, 3)))
    uv = camera.project(se3.apply(se3.inverse(X) @ T, TIP)) + 0.1 * rng.standard_normal((5, 2))
    known = CalibrationResult(
        "hand-eye", "ok", cameras={"camera": camera}, transforms=(as_transform("base", "camera", X, 1e-8 * np.eye(6)),)
    )
    result = known.write(tmp_path / "he.json")
    pixels = tmp_path / "tip.csv"
    # Out of order on purpose: they belong together by name.
    order = [3, 0, 4, 1, 2]
    pixels.write_text("image,u,v\n" + "\n".join(f"{i}.png,{uv[i, 0]:.4f},{uv[i, 1]:.4f}" for i in order))
    given = ["tool", "seen", "--poses", str(poses_file(T, tmp_path / "p.csv")), "--result", str(result)]
    assert run([*given, "--pixels", str(pixels), "--json"]) == 0
    found = np.array(json.loads(capsys.readouterr().out)["transforms"][0]["matrix"])[:3, 3]
    np.testing.assert_allclose(found, TIP, atol=2e-3)
    elsewhere = uv[::-1] @ [[0.0, 1.0], [1.0, 0.0]]
    pixels.write_text("image,u,v\n" + "\n".join(f"{i}.png,{u:.2f},{v:.2f}" for i, (u, v) in enumerate(elsewhere)))
    assert run([*given, "--pixels", str(pixels)]) == 1
    assert "belong to one session?" in capsys.readouterr().err
    alone = CalibrationResult("intrinsics", "ok", cameras={"camera": camera}).write(tmp_path / "camera.json")
    assert run([*given[:-1], str(alone), "--pixels", str(pixels)]) == 2
    assert "expected the hand-eye result of a camera that stands still" in capsys.readouterr().err
    pixels.write_text("image,x,y\n0.png,1,2\n")
    assert run([*given, "--pixels", str(pixels)]) == 2
    assert "no column 'u'" in capsys.readouterr().err
    pixels.write_text("image,u,v\n0.png,1,here\n")
    assert run([*given, "--pixels", str(pixels)]) == 2
    assert "tip.csv:2" in capsys.readouterr().err


def test_self_visibility(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    camera, board = standard_camera(), parse_target("chessboard:9x6:12mm")
    T = se3.make(so3.exp([0.4, -0.1, 0.1]), [-0.05, -0.03, 0.25])
    T_target_gripper = se3.make(so3.exp([0, 0, 0.6]), [0.05, 0.09, 0.0])
    features = np.array([[0.02, 0.0, -0.003], [-0.02, 0.001, -0.003]])
    uv = camera.project(se3.apply(T @ T_target_gripper, features))
    image = tmp_path / "photo.png"
    cv2.imwrite(str(image), render(board.artwork(), camera, T, rng=np.random.default_rng(0)))
    lines = [f"{u:.3f},{v:.3f},{x},{y},{z}" for (u, v), (x, y, z) in zip(uv, 1e3 * features)]
    (tmp_path / "f.csv").write_text("u,v,x_mm,y_mm,z_mm\n" + "\n".join(lines))
    known = CalibrationResult("intrinsics", "ok", cameras={"camera": camera}).write(tmp_path / "camera.json")
    out = tmp_path / "hand.json"
    given = ["tool", "self-visibility", "--image", str(image), "--features", str(tmp_path / "f.csv")]
    given += ["--camera", str(known)]
    assert run([*given, "--target", "chessboard:9x6:12mm", "--out", str(out), "--quiet"]) == 0
    estimate = read_result(out).transform("gripper", "camera")
    # The board may be numbered from its other end: then the gripper lies on the plane turned by half a turn, the same
    # camera in the gripper.
    assert normalised(estimate, se3.inverse(T @ T_target_gripper)) < 30
    assert run(given) == 2
    assert "--target" in capsys.readouterr().err
