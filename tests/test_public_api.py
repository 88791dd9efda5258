"""The promise of the README: Python in five lines, and an import that costs nothing."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.simulate.scenes import hand_eye_scene, intrinsics_scene


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda: cb.read(3), "no path of a file"),
        (lambda: cb.read_poses(3), "files takes a text, a path"),
        (lambda: cb.detect(3, target="chessboard:9x6:25mm"), "images are names of files"),
        (lambda: cb.detect([None], target="chessboard:9x6:25mm"), "images are names of files"),
        (lambda: cb.parse_target(3), "a target's spec is text"),
        (lambda: cb.calibrate_intrinsics("photos"), "not str; calibrant.intrinsics takes photos"),
        (lambda: cb.calibrate_hand_eye("a.csv", "b.csv", setup="eye-in-hand"), "matrices of numbers, .* got 'a.csv'"),
        (lambda: cb.calibrate_hand_eye(3, 4, setup="eye-in-hand"), "expected 4x4 matrices"),
        (lambda: cb.RobotPoses.from_matrices([[1.0], [2.0, 3.0]]), "expected 4x4 matrices of numbers"),
    ],
)
def test_values_of_the_wrong_kind_are_unusable_input(wrong, words: str) -> None:
    """As the commands say it, not what came of it some functions further down."""
    with pytest.raises(cb.InputError, match=words):
        wrong()


def test_poses_read_from_a_file_are_shown_in_one_line(tmp_path) -> None:
    rows = [f"{0.1 * i},0.2,{0.5 + 0.05 * i},0,0,{np.sin(0.2 * i):.6f},{np.cos(0.2 * i):.6f}" for i in range(1, 6)]
    (tmp_path / "poses.csv").write_text("x,y,z,qx,qy,qz,qw\n" + "\n".join(rows) + "\n")
    shown = repr(cb.read_poses(tmp_path / "poses.csv")[0])
    assert shown.startswith("PoseNotation(5 poses, ")
    assert "quaternions x y z w, T_base_gripper" in shown
    assert len(shown) < 300


def test_the_import_loads_nothing_heavy() -> None:
    code = (
        "import sys, calibrant\n"
        "heavy = ('numpy', 'scipy', 'numba', 'cv2', 'matplotlib', 'pydantic', 'rich', 'cyclopts')\n"
        "print([m for m in heavy if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == "[]"


def test_every_public_name_is_there() -> None:
    for name in cb.__all__:
        assert getattr(cb, name) is not None
    with pytest.raises(AttributeError, match="calibrate_intrinsics"):
        cb.calibrate_everything  # noqa: B018 - the message lists what there is


def test_intrinsics_in_five_lines(tmp_path: Path) -> None:
    scene = intrinsics_scene(6)
    points, uv = [v.points for v in scene.observations.views], [v.uv for v in scene.observations.views]
    observations = cb.Observations.from_points(points, uv, image_size=(1280, 1024))
    result = cb.calibrate_intrinsics(observations, model="brown")
    assert result.camera.parameters["fx"] == pytest.approx(1102.4, abs=6 * result.camera.sigma["fx"])
    assert result.rms_px == pytest.approx(np.sqrt(2) * result.sigma_px, rel=0.1)
    assert len(result.views) == 6
    p_camera = np.array([[0.1, -0.05, 0.6], [0.0, 0.0, 1.0]])
    pixels = result.camera.project(p_camera)
    assert pixels.shape == (2, 2)
    rays = result.camera.unproject(pixels)
    assert rays == pytest.approx(p_camera / np.linalg.norm(p_camera, axis=1, keepdims=True), abs=1e-9)
    result.write(tmp_path / "camera.json")
    again = cb.read(tmp_path / "camera.json")
    assert again.camera.parameters == result.camera.parameters
    assert cb.calibrate_intrinsics(again.observations).camera.parameters == result.camera.parameters


def test_hand_eye_from_matrices_and_from_observations() -> None:
    scene = hand_eye_scene("good", views=8)
    T_base_gripper = scene.robot_poses.T_base_gripper
    for target in (scene.measured_T_camera_target, scene.observations):
        result = cb.calibrate_hand_eye(T_base_gripper, target, setup="eye-in-hand")
        T = result.transform("gripper", "camera")
        assert np.linalg.norm(T.matrix[:3, 3] - scene.X[:3, 3]) < 2e-3
        assert T.covariance.shape == (6, 6)


def test_errors_are_of_one_family() -> None:
    with pytest.raises(cb.InputError, match="1 robot poses but 2 target poses"):
        cb.calibrate_hand_eye(np.eye(4)[None], np.stack([np.eye(4)] * 2), setup="eye-in-hand")
    with pytest.raises(cb.RefusedError, match="at least 3"):
        cb.calibrate_hand_eye(np.stack([np.eye(4)] * 2), np.stack([np.eye(4)] * 2), setup="eye-in-hand")
    assert issubclass(cb.InputError, cb.CalibrantError)
    assert issubclass(cb.RefusedError, cb.CalibrantError)


def test_detect_is_a_function(tmp_path: Path) -> None:
    with pytest.raises(cb.InputError, match="does not exist"):
        cb.detect([str(tmp_path / "none.png")], target="charuco:5x7:36.195mm:18.256mm:DICT_6X6_250")


def test_geometry_is_a_door_to_its_modules() -> None:
    import importlib

    for name in cb.geometry.__all__:
        assert getattr(cb.geometry, name) is importlib.import_module(f"calibrant.geometry.{name}")
    assert cb.geometry is importlib.import_module("calibrant.geometry")
    with pytest.raises(AttributeError, match="it has frame_tree, frames, grasp_equations"):
        cb.geometry.quaternions  # noqa: B018 - the message lists what there is
    files = {f.stem for f in Path(cb.geometry.__file__ or "").parent.glob("*.py")} - {"__init__"}
    assert files == set(cb.geometry.__all__)


def test_the_door_to_geometry_loads_nothing_until_asked() -> None:
    code = "import sys, calibrant; calibrant.geometry; print([m for m in sys.modules if 'calibrant.geometry.' in m])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == "[]"
