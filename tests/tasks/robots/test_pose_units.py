"""Poses in another unit than they are read in, or than an option says: the cause is named, the right thing mended."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import calibrant as cb
from calibrant.geometry import rotations
from calibrant.simulate.scenes import HandEyeScene, hand_eye_scene

INCH = 0.0254


@pytest.fixture(scope="module")
def scene() -> HandEyeScene:
    return hand_eye_scene("good", setup="eye-in-hand", views=14)


def written(
    file: Path, T: NDArray[np.float64], *, unit: float = 1.0, turn: float = 1.0, words: str = "x,y,z,rx,ry,rz"
) -> str:
    """A file of positions and rotation vectors, over their units."""
    rows = [f"image,{words}"]
    for i, pose in enumerate(T):
        vector = rotations.rotation_vector_from_matrix(pose[:3, :3], unit="rad") / turn
        rows.append(f"{i}.png," + ",".join(repr(float(v)) for v in (*(pose[:3, 3] / unit), *vector)))
    file.write_text("\n".join(rows) + "\n")
    return str(file)


def given(
    scene: HandEyeScene, folder: Path, *, unit: float = 1.0, turn: float = 1.0, target: float = 1.0
) -> dict[str, str]:
    """The scene's poses as files in these units; target: what the target's lengths are given too large by."""
    B = scene.measured_T_camera_target.copy()
    B[:, :3, 3] *= target
    return {
        "poses": written(folder / "poses.csv", scene.robot_poses.T_base_gripper, unit=unit, turn=turn),
        "target_poses": written(folder / "target.csv", B),
        "setup": "eye-in-hand",
    }


def test_poses_in_inches_are_made_larger_and_the_target_stays(scene: HandEyeScene, tmp_path: Path) -> None:
    asked = given(scene, tmp_path, unit=INCH)
    repaired = tmp_path / "repaired.csv"
    result = cb.doctor(**asked, apply=True, repaired_poses=repaired)
    fault = next(c for c in result.checks if c.name == "pose-units")
    assert "in inches and were read in" in fault.message
    truth = cb.hand_eye(**(asked | {"poses": written(tmp_path / "m.csv", scene.robot_poses.T_base_gripper)}))
    np.testing.assert_allclose(
        result.transform("gripper", "camera").matrix, truth.transform("gripper", "camera").matrix, atol=1e-6
    )
    first = np.array(repaired.read_text().splitlines()[1].split(",")[1:4], dtype=float)
    np.testing.assert_allclose(first, scene.robot_poses.T_base_gripper[0, :3, 3], atol=1e-9)


def test_a_target_of_another_unit_is_no_fault_of_the_poses(scene: HandEyeScene, tmp_path: Path) -> None:
    """Poses in mm of an arm that reaches 0.5 m; cm said for a target's mm: ten times too large."""
    with pytest.raises(cb.RefusedError, match=r"target-size: .*cm instead of mm"):
        cb.hand_eye(**given(scene, tmp_path, unit=1e-3, target=10.0))


@pytest.mark.long
@pytest.mark.parametrize(("said", "turn", "words"), [("rad", np.pi / 180, "degrees"), ("deg", 1.0, "radians")])
def test_an_angle_that_contradicts_the_data_is_named(
    scene: HandEyeScene, tmp_path: Path, said: str, turn: float, words: str
) -> None:
    """Degrees read as radians look like unrelated motions, radians read as degrees like a robot that never turned."""
    with pytest.raises(cb.RefusedError) as refused:
        cb.hand_eye(**given(scene, tmp_path, unit=1e-3, turn=turn), pose_angle=said)
    message = str(refused.value)
    assert message.startswith(
        f"pose-options: pose_angle {said} contradicts the data: read as rotation vectors in {words}"
    )
    assert "no-agreement" not in message
    assert "pure-translation" not in message


@pytest.mark.long
def test_an_option_that_agrees_is_no_cause(scene: HandEyeScene, tmp_path: Path) -> None:
    """Poses that belong to no target at all: what was said of their angles is not what is wrong."""
    asked = given(scene, tmp_path, turn=np.pi / 180)
    shuffled = scene.robot_poses.T_base_gripper[np.random.default_rng(2).permutation(14)]
    shuffled[:, :3, :3] = rotations.matrix_from_rotation_vector(
        np.random.default_rng(1).normal(size=(14, 3)), unit="rad"
    )
    asked["poses"] = written(tmp_path / "other.csv", shuffled, turn=np.pi / 180)
    with pytest.raises(cb.RefusedError) as refused:
        cb.hand_eye(**asked, pose_angle="deg")
    assert "pose-options" not in str(refused.value)
