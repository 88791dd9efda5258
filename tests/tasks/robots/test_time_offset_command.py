"""`calibrant time-offset` from files with times."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from calibrant.cli.application import run
from calibrant.geometry import rotations, se3, so3


def save(path: Path, times: np.ndarray, T: np.ndarray, time_header: str) -> None:
    q = rotations.quaternion_xyzw_from_matrix(T[:, :3, :3])
    rows = np.column_stack([T[:, :3, 3], q])
    lines = [f"{time_header},x,y,z,qx,qy,qz,qw"]
    lines += [",".join([f"{t:.6f}", *(f"{v:.9f}" for v in row)]) for t, row in zip(times, rows)]
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sweep of 6 s; the camera's clock 80 ms behind; the robot's times since 1970, the camera's in ms."""
    path = tmp_path_factory.mktemp("sweep")
    rng = np.random.default_rng(0)

    def gripper(t: np.ndarray) -> np.ndarray:
        w = np.stack([0.5 * np.sin(1.3 * t), 0.4 * np.sin(0.9 * t + 1), 0.5 * np.cos(1.7 * t)], axis=-1)
        p = np.stack([0.5 + 0.15 * np.sin(1.1 * t), 0.2 * np.cos(0.8 * t), 0.4 + 0.1 * np.sin(1.9 * t)], axis=-1)
        return se3.make(so3.exp(w), p)

    X, Z = se3.exp([0.3, -0.2, 0.5, 0.03, -0.05, 0.1]), se3.exp([2.9, 0.1, 0.2, 0.6, 0.1, 0.0])
    robot, camera = np.arange(0, 8, 0.01), np.arange(1, 7, 0.033)
    B = se3.retract(se3.inverse(gripper(camera) @ X) @ Z, rng.normal(scale=2e-4, size=(len(camera), 6)))
    save(path / "robot.csv", 1.7e9 + robot, gripper(robot), "timestamp")
    save(path / "camera.csv", 1e3 * (1.7e9 + camera - 0.08), B, "time[ms]")
    save(path / "plain.csv", camera, B, "index")
    return path


def test_the_offset_comes_out(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ["--poses", str(folder / "robot.csv"), "--target-poses", str(folder / "camera.csv")]
    assert run(["time-offset", *given, "--json"]) == 0
    offset = json.loads(capsys.readouterr().out)["figures"]["offset"]
    assert abs(offset["value"] - 0.08) < 4 * offset["sigma"]
    assert offset["sigma"] < 1e-3
    assert offset["unit"] == "s"
    assert run(["time-offset", *given]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "t_robot = t_camera + " in text
    assert "the camera's clock is behind the robot's; add" in text
    assert "GOOD. The offset is known to" in text


def test_samples_that_a_recorder_wrote_twice_are_left_out(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    header, *lines = (folder / "robot.csv").read_text().splitlines()
    twice = folder / "twice.csv"
    twice.write_text(
        "\n".join([header, *(line for i, row in enumerate(lines) for line in [row] * (1 + (i % 25 == 3)))])
    )
    assert run(["time-offset", "--poses", str(twice), "--target-poses", str(folder / "camera.csv")]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert f"{len(range(3, len(lines), 25))} samples that repeat the one before are left out; camera: " in text
    lines[9] = lines[8].replace(",0.", ",0.1", 1)  # the same moment at another place
    twice.write_text("\n".join([header, *lines]))
    assert run(["time-offset", "--poses", str(twice), "--target-poses", str(folder / "camera.csv")]) == 2
    assert "times do not increase at sample" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["--poses", "robot.csv", "--target-poses", "plain.csv"], 2, "no times; expected a column 'timestamp'"),
        (["--poses", "robot.csv", "--target-poses", "camera.csv", "--largest", "2"], 2, "takes a time with its unit"),
        (["--poses", "robot.csv", "--target-poses", "camera.csv", "--largest", "20ms"], 1, "search wider"),
        (
            ["--poses", "robot.csv", "--target-poses", "camera.csv", "--setup", "eye-to-hand"],
            1,
            "is the camera mounted otherwise (--setup eye-in-hand)",
        ),
        (["--poses", "robot.csv", "--target-poses", "camera.csv", "--setup", "eye"], 2, "unknown setup 'eye'"),
    ],
)
def test_what_cannot_be_done_is_said(
    folder: Path,
    arguments: list[str],
    status: int,
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    assert run(["time-offset", *arguments]) == status
    assert message in capsys.readouterr().err
