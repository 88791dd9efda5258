"""One camera on one robot is a cell of one list: both doors give the same digits, checks and refusals."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import pytest

from calibrant.calibrate.cell.calibrate import calibrate_cell
from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.calibrate.cell.problem.layout import Pictures, TargetPoses
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Observations, RobotPoses
from calibrant.errors import RefusedError
from calibrant.formats.poses.read import read_poses
from calibrant.simulate.scenes import HAND_EYE_SCENES, hand_eye_scene

Array = np.ndarray
Door = Callable[[RobotPoses, Observations | Array, str, Camera | None], CalibrationResult]


def by_hand_eye(
    poses: RobotPoses, target: Observations | Array, setup: str, camera: Camera | None
) -> CalibrationResult:
    return calibrate_hand_eye(poses, target, setup=setup, camera=camera)


def by_cell(poses: RobotPoses, target: Observations | Array, setup: str, camera: Camera | None) -> CalibrationResult:
    seen = target if isinstance(target, Observations) else TargetPoses(poses.ids, target)
    known = {} if camera is None else {"camera": camera}
    return calibrate_cell(poses, [Pictures("camera", setup, seen)], cameras=known)


DOORS: list[Door] = [by_hand_eye, by_cell]


def outcome(door: Door, *arguments: object) -> CalibrationResult | str:
    """The result, or the words of the refusal."""
    try:
        return door(*arguments)  # type: ignore[arg-type]
    except RefusedError as error:
        return str(error)


def assert_the_same(poses: RobotPoses, target: Observations | Array, setup: str, camera: Camera | None = None) -> None:
    first, second = (outcome(door, poses, target, setup, camera) for door in DOORS)
    if isinstance(first, str) or isinstance(second, str):
        assert first == second
        return
    for a, b in zip(first.transforms, second.transforms, strict=True):
        assert (a.parent, a.child) == (b.parent, b.child)
        np.testing.assert_array_equal(a.matrix, b.matrix)
        np.testing.assert_array_equal(a.covariance, b.covariance)
    assert first.checks == second.checks
    assert first.verdict == second.verdict
    for name in ("rms_px", "sigma_px", "sigma_robot", "target_scale", "held_out", "options", "decided"):
        assert getattr(first, name) == getattr(second, name), name
    assert first.methods.keys() == second.methods.keys()
    seen = [[(v.id, v.used, v.points, v.rms_px, v.reason) for v in r.views] for r in (first, second)]
    assert seen[0] == seen[1]


@pytest.mark.parametrize("kind", ["photos", "camera given", "pose pairs"])
@pytest.mark.parametrize("name", HAND_EYE_SCENES)
def test_simulated_scenes(name: str, kind: str) -> None:
    setup = ("eye-in-hand", "eye-to-hand")[(list(HAND_EYE_SCENES).index(name) + len(kind)) % 2]
    scene = hand_eye_scene(name, setup=setup, views=9, seed=1)  # type: ignore[arg-type]
    target = scene.measured_T_camera_target if kind == "pose pairs" else scene.observations
    assert_the_same(scene.robot_poses, target, setup, scene.camera if kind == "camera given" else None)


@pytest.mark.long
def test_real_pose_pairs(shared_data) -> None:
    samples = np.array(json.loads((shared_data("handeye_moveit_poses") / "pose_samples.json").read_text()))
    pairs = samples.reshape(-1, 2, 4, 4)
    for setup in ("eye-to-hand", "eye-in-hand"):
        assert_the_same(RobotPoses.from_matrices(pairs[:, 0]), pairs[:, 1], setup)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "spec", "setup"),
    [
        ("handeye_rct_charuco_static", "charuco:5x7:36.195mm:18.256mm:DICT_6X6_250", "eye-to-hand"),
        ("handeye_rct_circles_eih", "circles:10x10:25.4mm:bigdot", "eye-in-hand"),
    ],
)
def test_real_photos_right_wrong_and_shifted(shared_data, name: str, spec: str, setup: str) -> None:
    import calibrant as cb
    from calibrant.formats.poses.notations import notations
    from calibrant.formats.poses.pairing import match_raw

    folder = shared_data(name)
    files = sorted((folder / "images").iterdir())
    seen = cb.detect([str(f) for f in files], target=spec)
    raw = read_poses(folder / "poses")
    ids = [v.id for v in seen.views]
    pairing = match_raw(raw, ids)
    poses = notations(raw)[0].take(pairing.pose_index, [ids[i] for i in pairing.view_index]).poses
    assert_the_same(poses, seen, setup)
    other = {"eye-in-hand": "eye-to-hand", "eye-to-hand": "eye-in-hand"}[setup]
    shifted = RobotPoses(poses.ids, np.roll(poses.T_base_gripper, 1, axis=0))
    for faulty, said in ((poses, other), (shifted, setup)):
        assert_the_same(faulty, seen, said)
        found = outcome(by_cell, faulty, seen, said, None)
        # A grid of circles looks the same turned: with views numbered anew, a wrong setup may only be doubtful.
        assert isinstance(found, str) or (spec.startswith("circles") and found.verdict == "warn")


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize(
    ("scene", "words"),
    [
        ("parallel-axes", "parallel-axes: all rotations turn about one axis"),
        ("pure-translation", "pure-translation: the poses do not rotate"),
        ("two-poses", "at least 3"),
        ("shifted-pairs", "pairing"),
        ("inverted-poses", "use --setup eye-to-hand, or check whether the poses are inverted"),
    ],
)
def test_faults_that_pass_silently_elsewhere_are_refused_by_name(door: Door, scene: str, words: str) -> None:
    data = hand_eye_scene(scene, views=9)
    with pytest.raises(RefusedError, match=words):
        door(data.robot_poses, data.measured_T_camera_target, "eye-in-hand", None)


@pytest.mark.long
@pytest.mark.parametrize("scene", ["shifted-pairs", "inverted-poses"])
def test_a_second_camera_does_not_hide_the_fault(scene: str) -> None:
    """Two cameras on one robot whose poses are wrong: refused as one camera is, and the list is named."""
    data = hand_eye_scene(scene, views=12)
    lists = [Pictures(name, "eye-in-hand", data.observations) for name in ("left", "right")]
    with pytest.raises(RefusedError, match="left"):
        calibrate_cell(data.robot_poses, lists, cameras={"left": data.camera, "right": data.camera})
