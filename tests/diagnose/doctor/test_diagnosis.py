"""From files to findings: notations, orders and faults together, on simulated and on real data."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant.diagnose.doctor.diagnosis import Diagnosis, as_result, diagnose_poses
from calibrant.diagnose.doctor.faults.timing import times_of_names
from calibrant.diagnose.doctor.repair import calibrate_repaired
from calibrant.errors import RefusedError
from calibrant.formats.poses.read import PoseNotation, notations, read_poses
from calibrant.geometry import rotations, se3
from calibrant.simulate.scenes import hand_eye_scene
from calibrant.simulate.truth import normalised

Array = NDArray[np.float64]
BENCHMARK = Path(__file__).resolve().parents[3] / "benchmarks" / "doctor.py"
TRIALS = 1
"""The benchmark makes 200 of each; one of each keeps the whole table under test."""


def written(folder: Path, T: Array, *, order: str | None = None) -> tuple[PoseNotation, ...]:
    """Notations of poses written natively, or with Euler angles in degrees."""
    if order is None:
        header, turn = "qx,qy,qz,qw", rotations.quaternion_xyzw_from_matrix(T[:, :3, :3])
    else:
        header, turn = "e1,e2,e3", rotations.euler_from_matrix(T[:, :3, :3], order=order, unit="deg")
    rows = np.column_stack([T[:, :3, 3], turn])
    text = "\n".join(f"{i}.png," + ",".join(repr(float(x)) for x in row) for i, row in enumerate(rows))
    (folder / "poses.csv").write_text(f"image,x,y,z,{header}\n{text}\n")
    return notations(read_poses(folder / "poses.csv"))


def names(found: Diagnosis) -> list[str]:
    return [f.name for f in found.findings if f.status != "ok"]


def test_clean_poses_have_no_findings(tmp_path: Path) -> None:
    for setup in ("eye-in-hand", "eye-to-hand"):
        scene = hand_eye_scene("good", setup=setup)
        found = diagnose_poses(written(tmp_path, scene.robot_poses.T_base_gripper), scene.measured_T_camera_target)
        assert names(found) == []
        assert (found.sound, found.poses.setup) == (True, setup)


def test_shifted_poses_in_euler_angles_of_an_unknown_order(tmp_path: Path) -> None:
    scene = hand_eye_scene("good", setup="eye-to-hand")
    T = scene.robot_poses.T_base_gripper
    found = diagnose_poses(written(tmp_path, np.roll(T, -1, axis=0), order="ZYX"), scene.measured_T_camera_target)
    assert names(found) == ["poses-shifted"]
    assert [f.name for f in found.findings] == ["poses-shifted", "pose-rotation"]
    assert "Euler angles ZYX" in found.named("pose-rotation")[0].message
    np.testing.assert_allclose(found.repaired.poses.T_base_gripper, T, atol=1e-9)


def test_a_target_that_moved_halfway_does_not_hide_the_reading(tmp_path: Path) -> None:
    scene = hand_eye_scene("good", views=16)
    B = scene.measured_T_camera_target.copy()
    B[9:] = B[9:] @ se3.make(np.eye(3), [0.2, -0.1, 0.0])
    found = diagnose_poses(written(tmp_path, scene.robot_poses.T_base_gripper), B)
    assert names(found) == ["target-moved"]
    assert found.findings[0].views == ("8.png", "9.png")
    assert found.poses.setup == "eye-in-hand"


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_inverted_target_poses_by_where_the_target_would_be(tmp_path: Path, setup: str) -> None:
    scene = hand_eye_scene("good", setup=setup)  # type: ignore[arg-type]
    T, B = scene.robot_poses.T_base_gripper, scene.measured_T_camera_target
    found = diagnose_poses(written(tmp_path, T), se3.inverse(B), setup=setup)  # type: ignore[arg-type]
    assert names(found) == ["target-pose-direction"]
    np.testing.assert_allclose(found.repaired.B, B, atol=1e-9)
    assert found.poses.setup == setup
    # Where nobody said the setup, the camera's frame may as well be one that is not optical: a person is asked.
    found = diagnose_poses(written(tmp_path, T), se3.inverse(B))
    assert names(found) == ["target-pose-direction"]
    assert not found.findings[0].proposal
    assert "--setup" in found.findings[0].message


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize(("axis", "name"), [([[0, -1, 0], [0, 0, -1], [1, 0, 0]], "+x"), (np.diag([1, -1, -1]), "-z")])
def test_a_camera_frame_that_is_not_optical_is_kept(tmp_path: Path, setup: str, axis: Array, name: str) -> None:
    """ROS body and OpenGL: T_other_optical, the same target in another frame of the camera."""
    scene = hand_eye_scene("good", setup=setup)  # type: ignore[arg-type]
    T_other_optical = se3.make(np.asarray(axis, dtype=float).T, np.zeros(3))
    B = T_other_optical @ scene.measured_T_camera_target
    found = diagnose_poses(written(tmp_path, scene.robot_poses.T_base_gripper), B, setup=setup)  # type: ignore[arg-type]
    assert "target-pose-direction" not in names(found)
    np.testing.assert_allclose(found.repaired.B, B, atol=1e-9)
    assert f"looks along {name} of its own frame" in found.named("camera-frame")[0].message


def test_a_track_is_read_as_it_is_and_asked_about_where_the_setup_turns(tmp_path: Path) -> None:
    scene = hand_eye_scene("good")
    track = scene.measured_T_camera_target @ se3.inverse(scene.measured_T_camera_target[0])
    poses = written(tmp_path, scene.robot_poses.T_base_gripper)
    assert names(diagnose_poses(poses, track)) == []
    asked = diagnose_poses(poses, se3.inverse(track))  # T_map_camera, as odometry gives it: eye-to-hand by the loop
    assert names(asked) == ["target-pose-direction"]
    assert not asked.findings[0].proposal
    said = diagnose_poses(poses, se3.inverse(track), setup="eye-in-hand")
    assert names(said) == ["target-pose-direction"]
    np.testing.assert_allclose(said.repaired.B, track, atol=1e-9)


def test_degenerate_motions_are_refused_by_name(tmp_path: Path) -> None:
    for scene_name, word in (
        ("parallel-axes", "parallel-axes"),
        ("pure-translation", "pure-translation"),
        ("two-poses", "poses"),
    ):
        scene = hand_eye_scene(scene_name)
        word = "poses" if scene_name == "two-poses" else scene_name
        with pytest.raises(RefusedError, match=f"^{word}: "):
            diagnose_poses(written(tmp_path, scene.robot_poses.T_base_gripper), scene.measured_T_camera_target)


def test_unrelated_poses_are_not_read_in_any_way(tmp_path: Path) -> None:
    T = hand_eye_scene("good", seed=3).robot_poses.T_base_gripper
    B = hand_eye_scene("good", seed=4).measured_T_camera_target
    found = diagnose_poses(written(tmp_path, T), B)
    assert "no-agreement" in names(found)
    assert not found.sound


@pytest.mark.statistics
def test_one_flip_is_found_and_the_result_is_within_its_sigma(tmp_path: Path) -> None:
    """Fifteen views, one flipped: the repaired result lies within about 1 sigma of the truth."""
    inside = 0
    for seed in range(5):
        scene = hand_eye_scene("one-flip", seed=seed)
        found = diagnose_poses(written(tmp_path, scene.robot_poses.T_base_gripper), scene.measured_T_camera_target)
        assert names(found) == ["board-flipped"]
        assert found.findings[0].views == ("7.png",)
        estimate = calibrate_repaired(found).transforms[0]
        inside += bool(np.sqrt(normalised(estimate, scene.X) / 6) < 1)
    # chi-square of 6 below its 6: P = 0.58; five trials give none with 1.3 %.
    assert inside >= 1


def test_the_result_of_the_doctor_says_what_it_found(tmp_path: Path) -> None:
    scene = hand_eye_scene("one-flip")
    result = as_result(
        diagnose_poses(written(tmp_path, scene.robot_poses.T_base_gripper), scene.measured_T_camera_target)
    )
    assert (result.kind, result.verdict) == ("doctor", "warn")
    assert result.check("board-flipped").message.startswith("7.png: the board is numbered from the opposite corner")
    assert result.figures["loop_before_mm"].value > 10 > result.figures["loop_after_mm"].value


def test_times_are_read_from_names_that_are_time_stamps() -> None:
    assert times_of_names(("0.png", "1.png", "2.png")) is None
    assert times_of_names(("left.png", "right.png")) is None
    np.testing.assert_allclose(times_of_names(("1305031452.79.png", "1305031453.04.png")), [0, 0.25], atol=1e-6)
    np.testing.assert_allclose(times_of_names(("1403636579763555584", "1403636579813555456")), [0, 0.05], atol=1e-6)


@pytest.fixture(scope="module")
def benchmark() -> ModuleType:
    """benchmarks/doctor.py as a module."""
    spec = importlib.util.spec_from_file_location("doctor_benchmark", BENCHMARK)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def sample(request: pytest.FixtureRequest, benchmark: ModuleType, shared_data: Callable[[str], Path]) -> object:
    shared_data({"moveit": "handeye_moveit_poses", "charuco": "handeye_rct_charuco_static"}[request.param])
    return request.param, benchmark.DATA_SETS[request.param][0]()


@pytest.mark.long
@pytest.mark.parametrize("sample", ["moveit", "charuco"], indirect=True)
def test_real_data_corrupted_in_every_way(benchmark: ModuleType, sample: tuple, tmp_path: Path) -> None:
    name, data = sample
    _, clean_sizes, sizes = benchmark.DATA_SETS[name]
    for fault in benchmark.FAULTS:
        row = benchmark.run_fault(fault, data, sizes, TRIALS, 0, tmp_path)
        assert row.named == 1, (fault, row.remarks)
    row = benchmark.run_clean(data, clean_sizes, 3 * TRIALS, tmp_path)
    assert row.named == 0, row.remarks
