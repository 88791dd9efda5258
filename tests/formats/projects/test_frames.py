"""Where components are: by results, by what was typed in, and in any frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.data import CalibrationResult, as_transform
from calibrant.data.results import JointCovariance
from calibrant.errors import InputError
from calibrant.formats.projects.chains import covariance_between
from calibrant.formats.projects.edits import placed, renamed, with_component, with_world, without
from calibrant.formats.projects.frames import NOWHERE, SOLVED, Scene, frame_named, world_of
from calibrant.formats.projects.records import TYPED, Component, Kept, Placement, Project
from calibrant.geometry import rotations, se3
from calibrant.simulate.truth import normalised

RNG = np.random.default_rng(3)
T_GRIPPER_LEFT, T_GRIPPER_RIGHT, T_BASE_BOARD = (se3.exp(RNG.normal(scale=0.5, size=6)) for _ in range(3))
SPREAD = RNG.normal(scale=1e-4, size=(18, 18))
C = SPREAD @ SPREAD.T
FRAMES = (("gripper", "left"), ("gripper", "right"), ("base", "board"))
RESULT = CalibrationResult(
    "hand-eye",
    "ok",
    transforms=tuple(
        as_transform(*frame, T, C[6 * k : 6 * k + 6, 6 * k : 6 * k + 6])
        for k, (frame, T) in enumerate(zip(FRAMES, (T_GRIPPER_LEFT, T_GRIPPER_RIGHT, T_BASE_BOARD)))
    ),
    joint_covariance=JointCovariance(FRAMES, C),
)
KEPT = Kept(of="cell", name="hand", file="results/cell-0.json", sha256="", robots=("ur",))


def cell() -> Project:
    out = Project()
    kinds = {"ur": "robot", "left": "camera", "right": "camera", "top": "camera", "table": "frame"}
    for name, kind in kinds.items():
        out = with_component(out, name, Component(kind=kind))
    return with_component(out, "board", Component(kind="target", spec="chessboard:9x6:25mm"))


def typed(frame: str, xyz: tuple[float, float, float], ypr: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Placement:
    return Placement(relative_to=frame, xyz_mm=xyz, ypr_deg=ypr, source=TYPED)


def scene(project: Project) -> Scene:
    return Scene.of(project, [(KEPT, RESULT)])


def test_any_component_is_found_in_any_frame_that_leads_to_it() -> None:
    found = scene(cell())
    left = found.place("left", "right")
    np.testing.assert_allclose(left.T, se3.inverse(T_GRIPPER_RIGHT) @ T_GRIPPER_LEFT, atol=1e-12)
    assert left.xyz_mm is not None
    assert left.ypr_deg is not None
    np.testing.assert_allclose(
        se3.make(rotations.matrix_from_yaw_pitch_roll(left.ypr_deg, unit="deg"), left.xyz_mm / 1e3), left.T, atol=1e-12
    )
    board = found.place("ur", "board")
    np.testing.assert_allclose(board.T, se3.inverse(T_BASE_BOARD), atol=1e-12)
    assert (left.source, board.source) == (SOLVED, SOLVED)


def test_a_camera_on_a_gripper_is_nowhere_in_the_base_and_shown_in_the_gripper() -> None:
    left = scene(cell()).place("left", "base")
    assert (left.relative_to, left.source) == ("ur_gripper", SOLVED)
    np.testing.assert_allclose(left.T, T_GRIPPER_LEFT, atol=1e-12)
    assert scene(cell()).place("top", "base").source == NOWHERE
    rig = CalibrationResult("rig", "ok", transforms=(as_transform("left", "right", T_GRIPPER_LEFT),))
    apart = Scene.of(cell(), [(replace(KEPT, robots=()), rig)])
    assert [apart.place(name, "top").relative_to for name in ("left", "right")] == ["left", "left"]


def test_the_frames_of_an_only_robot_have_two_names() -> None:
    project = cell()
    assert (frame_named(project, "base"), frame_named(project, "gripper")) == ("ur", "ur_gripper")
    assert world_of(project) == "ur"
    more = with_component(project, "kuka", Component(kind="robot"))
    with pytest.raises(InputError, match=r"no component called 'base'; there are: ur, left, .*kuka_gripper"):
        frame_named(more, "base")


def test_a_typed_pose_has_no_sigma_and_stands_in_the_place_of_a_result_for_its_component_alone() -> None:
    project = placed(cell(), "left", typed("gripper", (1.0, 2.0, 3.0), (90.0, 0.0, 0.0)))
    found = scene(project)
    left = found.place("left", "gripper")
    assert (left.source, left.sigma_mm) == (TYPED, None)
    np.testing.assert_allclose(
        left.T[:3, :3] if left.T is not None else None, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15
    )
    right = found.place("right", "gripper")
    np.testing.assert_allclose(right.T, T_GRIPPER_RIGHT, atol=1e-12)
    assert right.sigma_mm is not None
    across = found.place("right", "left")
    assert set(across.source.split(", ")) == {SOLVED, TYPED}
    assert across.sigma_mm is None


def test_a_typed_pose_joins_what_nothing_joined() -> None:
    project = placed(cell(), "ur", typed("table", (100.0, 0.0, 0.0)))
    board = scene(project).place("board", "table")
    np.testing.assert_allclose(board.T, se3.make(np.eye(3), [0.1, 0, 0]) @ T_BASE_BOARD, atol=1e-12)
    assert set(board.source.split(", ")) == {SOLVED, TYPED}


def test_a_rig_follows_its_camera_and_a_gripper_never_sticks_to_its_base() -> None:
    rig = CalibrationResult("rig", "ok", transforms=(as_transform("left", "right", T_GRIPPER_LEFT),))
    project = placed(cell(), "left", typed("table", (0.0, 0.0, 500.0)))
    found = Scene.of(project, [(replace(KEPT, robots=()), rig)])
    np.testing.assert_allclose(
        found.place("right", "table").T, se3.make(np.eye(3), [0.0, 0.0, 0.5]) @ T_GRIPPER_LEFT, atol=1e-12
    )
    # The left camera is on the gripper: typed in before the board it leaves it, and the right one stays there.
    moved = scene(placed(cell(), "left", typed("board", (0.0, 0.0, 500.0))))
    np.testing.assert_allclose(
        moved.place("left", "base").T, T_BASE_BOARD @ se3.make(np.eye(3), [0.0, 0.0, 0.5]), atol=1e-12
    )
    assert moved.place("right", "base").relative_to == "ur_gripper"
    assert moved.place("right", "gripper").source == SOLVED


def test_the_later_result_counts_and_the_earlier_adds_what_it_alone_has() -> None:
    moved = se3.make(np.eye(3), [0.0, 0.0, 0.5])
    before = CalibrationResult("cameras", "ok", transforms=(
        as_transform("left", "right", moved), as_transform("left", "top", moved)))  # fmt: skip
    given = replace(KEPT, of="given", robots=())
    found = Scene.of(cell(), [(given, before), (KEPT, RESULT)])
    np.testing.assert_allclose(found.place("right", "gripper").T, T_GRIPPER_RIGHT, atol=1e-12)
    np.testing.assert_allclose(found.place("top", "gripper").T, T_GRIPPER_LEFT @ moved, atol=1e-12)


def test_the_covariance_between_two_cameras_is_that_of_the_errors_they_share() -> None:
    """Against many draws of both transforms together."""
    found = covariance_between(RESULT, "right", "left")
    assert found is not None
    delta = np.random.default_rng(0).multivariate_normal(np.zeros(18), C, size=40_000)
    T = se3.inverse(se3.retract(T_GRIPPER_RIGHT, delta[:, 6:12])) @ se3.retract(T_GRIPPER_LEFT, delta[:, :6])
    drawn = np.cov(se3.local(se3.inverse(T_GRIPPER_RIGHT) @ T_GRIPPER_LEFT, T).T)
    # The spread of a covariance from n draws is sqrt(2 / n), 0.7 %; five of them.
    np.testing.assert_allclose(np.diag(found), np.diag(drawn), rtol=0.035)
    estimate = replace(RESULT.transforms[0], matrix=np.eye(4), covariance=found)
    assert normalised(estimate, np.eye(4)) == pytest.approx(0.0, abs=1e-12)


def test_a_transform_and_its_inverse_have_the_same_certainty() -> None:
    turned = covariance_between(RESULT, "left", "gripper")
    assert turned is not None
    back = CalibrationResult(
        "cameras", "ok", transforms=(as_transform("left", "gripper", se3.inverse(T_GRIPPER_LEFT), turned),)
    )
    np.testing.assert_allclose(covariance_between(back, "gripper", "left"), C[:6, :6], rtol=1e-6, atol=1e-14)


def test_what_cannot_be_is_refused() -> None:
    project = placed(cell(), "left", typed("top", (0.0, 0.0, 1.0)))
    with pytest.raises(InputError, match=r"turn in a circle: (top -> left -> top|left -> top -> left)"):
        placed(project, "top", typed("left", (0.0, 0.0, 1.0)))
    with pytest.raises(InputError, match="always at itself"):
        placed(project, "ur", typed("base", (0.0, 0.0, 1.0)))
    with pytest.raises(InputError, match="no component called 'nobody'; there are: ur, left, right"):
        placed(project, "left", typed("nobody", (0.0, 0.0, 1.0)))
    with pytest.raises(InputError, match="top is needed by the pose of left"):
        without(project, "top")
    with pytest.raises(InputError, match="a camera called 'left' already"):
        with_component(project, "LEFT", Component(kind="camera"))
    with pytest.raises(InputError, match="the gripper of ur is called so"):
        with_component(project, "ur_gripper", Component(kind="tool"))


def test_a_renamed_component_is_renamed_wherever_it_stands() -> None:
    project = with_world(placed(cell(), "left", typed("ur_gripper", (0.0, 0.0, 1.0))), "ur")
    after = renamed(project, "ur", "kuka")
    pose = after.components["left"].pose
    assert pose is not None
    assert (pose.relative_to, after.world, next(iter(after.components))) == ("kuka_gripper", "kuka", "kuka")
    with pytest.raises(InputError, match="a camera called 'top' already"):
        renamed(project, "left", "top")
