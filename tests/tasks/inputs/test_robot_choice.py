"""Poses from joint values and makers' formats on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from calibrant.cli.application import run
from calibrant.geometry import rotations, se3
from calibrant.robots.arms import arm


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Joints of a UR5e, its poses as its controller prints them, and target poses seen by a camera on the gripper."""
    folder = tmp_path_factory.mktemp("joints")
    rng = np.random.default_rng(2)
    q = np.array([0.2, -1.4, 1.6, -1.8, -1.5, 0.1]) + rng.uniform(-0.4, 0.4, (12, 6))
    T = arm("ur5e").forward(q)
    X, Z = se3.make(np.eye(3), [0.03, -0.05, 0.08]), se3.make(np.eye(3), [-0.5, 0.1, 0.0])
    B = se3.retract(se3.inverse(X) @ se3.inverse(T) @ Z, rng.normal(scale=2e-5, size=(12, 6)))
    quaternions = rotations.quaternion_xyzw_from_matrix(B[:, :3, :3])
    vectors = rotations.rotation_vector_from_matrix(T[:, :3, :3], unit="rad")
    save(folder / "joints.csv", "q1,q2,q3,q4,q5,q6", q)
    save(folder / "degrees.csv", "q1[deg],q2[deg],q3[deg],q4[deg],q5[deg],q6[deg]", np.rad2deg(q))
    save(folder / "ur.csv", "", np.column_stack([T[:, :3, 3], vectors]))
    save(folder / "target.csv", "x,y,z,qx,qy,qz,qw", np.column_stack([B[:, :3, 3], quaternions]))
    far = q.copy()
    far[3, 2] = 7.0
    save(folder / "far.csv", "q1,q2,q3,q4,q5,q6", far)
    return folder


def save(path: Path, header: str, rows: np.ndarray) -> None:
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.12g")


@pytest.mark.parametrize(
    "arguments",
    [["joints.csv", "--robot", "ur5e"], ["degrees.csv", "--robot", "ur5e"], ["ur.csv", "--robot-format", "ur"]],
    ids=["joints", "degrees", "ur"],
)
def test_hand_eye_from_joints_and_controller_poses(
    data: Path, arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(data)
    status = run(["hand-eye", "--target-poses", "target.csv", "--json", "--poses", *arguments])
    printed = capsys.readouterr()
    assert status == 0, printed.err
    found = next(t for t in json.loads(printed.out)["transforms"] if t["child"] == "camera")
    # 12 poses with noise of 20 micrometres and microradians: the camera is known to some hundredths of a millimetre.
    assert np.allclose(np.array(found["matrix"])[:3, 3], [0.03, -0.05, 0.08], atol=2e-4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["far.csv", "--robot", "ur5e", "--joint-angle", "rad"], "joint elbow is at 401.07 deg, beyond its limits"),
        (["joints.csv"], "say which robot they are of (--robot FILE"),
        (["joints.csv", "--robot", "ur6"], "no robot file ur6, and no robot of that name; known names: ur3e, ur5e"),
        (["ur.csv", "--robot-format", "urx"], "unknown robot format 'urx'; known: ur, franka"),
        (["ur.csv", "--robot-link", "tool0"], "--robot-link says something about a robot"),
        (["joints.csv", "--robot", "ur5e", "--robot-format", "ur"], "give one of them"),
    ],
)
def test_what_cannot_be_read_is_said(
    data: Path,
    arguments: list[str],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(data)
    assert run(["hand-eye", "--target-poses", "target.csv", "--poses", *arguments]) == 2
    assert message in capsys.readouterr().err
