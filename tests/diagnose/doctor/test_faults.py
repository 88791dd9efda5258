"""Each fault alone on simulated cells: named, undone, and not seen where it is not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant.cameras import Camera
from calibrant.diagnose.doctor import Case, Examination, examine
from calibrant.diagnose.doctor.evidence.case import stand_apart
from calibrant.diagnose.doctor.faults import exchanged, size
from calibrant.geometry import se3, so3
from calibrant.simulate.noise import flipped_board
from calibrant.simulate.scenes import gripper_poses, hand_eye_scene, observe, standard_mounting, target_poses

Array = NDArray[np.float64]
CaseOf = Callable[..., Case]


def names(found: Examination) -> list[str]:
    return [f.name for f in found.findings]


def undone(found: Examination, T: Array) -> None:
    """The robot poses of all views are the right ones again."""
    # Poses are freed of rounding where they are read.
    np.testing.assert_allclose(found.repaired.data.T_base_gripper, T, atol=1e-12)
    assert len(found.repaired.index) == len(T)


@pytest.mark.parametrize("scene", ["good", "noisy", "exact"])
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_clean_data_raise_no_alarm(pairs: CaseOf, views: CaseOf, scene: str, setup: str) -> None:
    for make in (pairs, views):
        found = examine(make(hand_eye_scene(scene, setup=setup)))  # type: ignore[arg-type]
        assert names(found) == []
        assert found.sound
        assert found.repaired is found.case


@pytest.mark.parametrize("n", [3, 4, 5, 6, 7])
def test_few_views_raise_no_alarm_about_the_data(pairs: CaseOf, n: int) -> None:
    # Few poses are a finding of their own.
    assert set(names(examine(pairs(hand_eye_scene("good", views=n))))) <= {"poses"}


@pytest.mark.parametrize("shift", [1, -1, 2])
def test_shifted_poses(pairs: CaseOf, shift: int) -> None:
    T = hand_eye_scene("good").robot_poses.T_base_gripper
    found = examine(pairs(T=np.roll(T, shift, axis=0)))
    assert names(found) == ["poses-shifted"]
    finding = found.findings[0]
    count = "one row" if abs(shift) == 1 else "2 rows"
    assert f"{count} too {'late' if shift > 0 else 'early'}" in finding.message
    assert finding.status == "fail"
    assert finding.evidence is not None
    assert finding.evidence.after.mm < 1 < 50 < finding.evidence.before.mm
    undone(found, T)


def test_poses_shifted_from_some_view_on(pairs: CaseOf) -> None:
    T = hand_eye_scene("good").robot_poses.T_base_gripper
    wrong = T.copy()
    wrong[6:] = np.roll(T[6:], 1, axis=0)
    found = examine(pairs(T=wrong))
    assert names(found) == ["poses-shifted"]
    assert "from 6.png on" in found.findings[0].message
    undone(found, T)


def test_a_lost_picture_leaves_one_view_without_a_pose(pairs: CaseOf) -> None:
    """The first picture is missing: every row is one late and the last has the pose of none."""
    scene = hand_eye_scene("good", views=16)
    T, B = scene.robot_poses.T_base_gripper[:15], scene.measured_T_camera_target[1:]
    found = examine(pairs(T=T, B=B))
    assert names(found) == ["poses-shifted", "bad-pose"]
    assert found.findings[1].views == ("14.png",)


@pytest.mark.parametrize("sorted_ones", ["poses", "images"])
def test_names_sorted_as_text(pairs: CaseOf, sorted_ones: str) -> None:
    T = hand_eye_scene("good").robot_poses.T_base_gripper
    text = sorted(range(15), key=lambda i: f"{i}.png")
    order = text if sorted_ones == "poses" else np.argsort(text)
    found = examine(pairs(T=T[order]))
    assert names(found) == ["poses-sorted-as-text"]
    undone(found, T)


def test_poses_backwards(pairs: CaseOf) -> None:
    T = hand_eye_scene("good").robot_poses.T_base_gripper
    found = examine(pairs(T=T[::-1]))
    assert names(found) == ["poses-backwards"]
    undone(found, T)


@pytest.mark.parametrize("rows", [(2, 9), (2, 9, 12)])
def test_swapped_poses(pairs: CaseOf, rows: tuple[int, ...]) -> None:
    T = hand_eye_scene("good").robot_poses.T_base_gripper
    wrong = T.copy()
    wrong[list(rows)] = T[list(rows[1:] + rows[:1])]
    found = examine(pairs(T=wrong))
    assert names(found) == ["poses-swapped"]
    assert found.findings[0].views == tuple(f"{i}.png" for i in rows)
    undone(found, T)


@pytest.mark.parametrize("flips", [1, 4])
def test_flipped_boards_of_views(views: CaseOf, flips: int) -> None:
    from dataclasses import replace

    scene = hand_eye_scene("good")
    seen = list(scene.observations.views)
    ends = scene.points.min(axis=0) + scene.points.max(axis=0)
    for k in range(3, 3 + flips):
        seen[k] = replace(seen[k], points=ends - seen[k].points, point_ids=len(scene.points) - 1 - seen[k].point_ids)
    bad = replace(scene, observations=replace(scene.observations, views=tuple(seen)))
    found = examine(views(bad))
    assert names(found) == ["board-flipped"]
    assert found.findings[0].views == tuple(f"{k}.png" for k in range(3, 3 + flips))
    repaired = found.repaired.data.views
    assert repaired is not None
    for new, old in zip(repaired, scene.observations.views):
        np.testing.assert_allclose(new.points, old.points, atol=1e-9)
        np.testing.assert_array_equal(new.point_ids, old.point_ids)


def test_a_flipped_board_among_poses_is_found_without_knowing_its_middle(pairs: CaseOf) -> None:
    scene = hand_eye_scene("one-flip")
    found = examine(pairs(scene))
    assert names(found) == ["board-flipped"]
    assert found.findings[0].views == ("7.png",)
    assert found.after is not None
    assert found.after.mm < 1


@pytest.mark.parametrize("turn", [np.pi / 2, -np.pi / 2])
def test_a_square_board_turned_by_a_quarter(pairs: CaseOf, turn: float) -> None:
    B = hand_eye_scene("good").measured_T_camera_target.copy()
    middle = np.array([0.1, 0.1, 0.0])
    R = so3.exp([0, 0, turn])
    B[5] = B[5] @ se3.make(R, middle - R @ middle)
    found = examine(pairs(B=B))
    assert names(found) == ["board-rotated"]
    assert found.findings[0].views == ("5.png",)
    assert found.after is not None
    assert found.after.mm < 1


def test_a_single_wrong_pose_is_left_out(pairs: CaseOf) -> None:
    T = hand_eye_scene("good").robot_poses.T_base_gripper.copy()
    T[4] = se3.retract(T[4], [0.01, 0.0, 0.0, 0.0, 0.005, 0.0])
    found = examine(pairs(T=T))
    assert names(found) == ["bad-pose"]
    assert found.findings[0].views == ("4.png",)
    assert found.repaired.ids == tuple(f"{i}.png" for i in range(15) if i != 4)


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("what", ["target", "camera"])
@pytest.mark.parametrize(("first", "mm"), [(5, 30.0), (10, 5.0)])
def test_something_that_moved_in_the_middle(pairs: CaseOf, setup: str, what: str, first: int, mm: float) -> None:
    scene = hand_eye_scene("good", setup=setup, views=15)  # type: ignore[arg-type]
    step = np.array([0.002 * mm, -0.001 * mm, 0.0, 1e-3 * mm, 0.0, 0.0])
    X, Z = scene.X, scene.Z
    X2, Z2 = (se3.retract(X, step), Z) if what == "camera" else (X, se3.retract(Z, step))
    exact = scene.T_camera_target
    noise = se3.inverse(exact) @ scene.measured_T_camera_target
    T_late = scene.T_base_gripper[first:]
    B = scene.measured_T_camera_target.copy()
    B[first:] = target_poses(scene.setup, X2, Z2, T_late) @ noise[first:]
    found = examine(pairs(scene, B=B))
    assert names(found) == [f"{what}-moved"]
    finding = found.findings[0]
    assert finding.views == (f"{first - 1}.png", f"{first}.png")
    assert finding.status == "fail"
    longer = range(first, 15) if first < 7.5 else range(first)
    assert found.repaired.ids == tuple(f"{i}.png" for i in longer)


@pytest.mark.parametrize("factor", [0.95, 1.02, 1000.0])
def test_a_target_of_another_size(pairs: CaseOf, views: CaseOf, factor: float) -> None:
    scene = hand_eye_scene("good")
    for case in (pairs(scene).scaled(factor), views(scene).scaled(factor)):
        found = examine(case)
        assert names(found) == ["target-size"]
        finding = found.findings[0]
        assert finding.measured is not None
        # `scaled` keeps what it did: the total is back at 1. 15 views give about 0.1 %.
        assert finding.measured.value == pytest.approx(1.0, abs=0.004)
        assert finding.status == ("fail" if factor == 1000 else "warn")
        if factor == 1000:
            assert "m instead of mm" in finding.message
        assert found.after is not None
        assert found.after.mm < 0.4


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_exchanged_files(pairs: CaseOf, setup: str) -> None:
    scene = hand_eye_scene("good", setup=setup)  # type: ignore[arg-type]
    T, B = scene.robot_poses.T_base_gripper, scene.measured_T_camera_target
    found = examine(pairs(scene, T=B, B=T))
    assert [(f.name, f.status) for f in found.findings if f.status != "ok"] == [("poses-exchanged", "warn")]
    # Nothing in the data tells: they are taken as given. All poses of one arm are one draw, in the cone by 0.15.
    np.testing.assert_allclose(found.repaired.data.T_base_gripper, B, atol=1e-12)
    assert found.findings[0].confidence == pytest.approx(0.85, abs=0.01)


def test_a_track_whose_frame_is_its_first_pose_has_no_target_in_front(pairs: CaseOf) -> None:
    scene = hand_eye_scene("good")
    above = se3.make(np.eye(3), [0.0, 0.0, 1.0])  # an arm that works above its base would pass for a camera's targets
    track = scene.measured_T_camera_target @ se3.inverse(scene.measured_T_camera_target[0])
    assert exchanged.examine(pairs(scene, T=above @ scene.robot_poses.T_base_gripper, B=track)) == []


@pytest.mark.parametrize(("far_off", "said"), [(2, []), (5, ["warn"]), (12, ["warn"])])
def test_some_targets_at_the_edge_of_a_wide_lens_are_a_cameras(pairs: CaseOf, far_off: int, said: list[str]) -> None:
    in_front = hand_eye_scene("good").measured_T_camera_target
    given = in_front.copy()
    given[:far_off, :3, 3] = [0.4, 0.0, 0.3]  # 53 degrees off the axis: the corner of a lens of 90 degrees
    found = exchanged.examine(pairs(T=in_front, B=given))
    assert [f.name for f in found] == ["poses-exchanged"] * len(said)
    assert [f.status for f in found] == said


def test_stale_intrinsics(views: CaseOf) -> None:
    scene = hand_eye_scene("good")
    old = Camera.create("brown", {**scene.camera.parameters, "fx": 1130.0, "fy": 1127.0}, image_size=(1280, 1024))
    found = examine(views(scene, camera=old))
    assert names(found) == ["stale-intrinsics"]
    assert "fx 1130.0 px given, 110" in found.findings[0].message
    assert names(examine(views(scene, camera=scene.camera))) == []


def test_stale_intrinsics_that_the_poses_of_the_views_take_up(views: CaseOf) -> None:
    # At 0.3 px a focal length 2 % too long leaves residuals only 5 % larger: what tells is the robot.
    scene = hand_eye_scene("good", views=15)
    seen = observe(scene.camera, scene.points, scene.T_camera_target, sigma_px=0.3, rng=np.random.default_rng(0))
    scene = replace(scene, observations=seen)
    p = scene.camera.parameters
    old = Camera.create("brown", {**p, "fx": 1.02 * p["fx"], "fy": 1.02 * p["fy"]}, image_size=(1280, 1024))
    found = examine(views(scene, camera=old))
    assert names(found) == ["stale-intrinsics"]
    assert found.findings[0].measured is not None
    assert found.findings[0].measured.value < 1.1
    assert names(examine(views(scene, camera=scene.camera))) == []


@pytest.mark.statistics
def test_target_poses_of_unequal_certainty_are_no_bad_poses() -> None:
    """Squares of Student's t with four degrees of freedom, the heaviest tail allowed for, six numbers a view."""
    rng = np.random.default_rng(0)
    raised = 0
    for _ in range(1000):
        statistic = rng.chisquare(6, 30) / (rng.chisquare(4, 30) / 4)
        raised += stand_apart(statistic > 9 * np.median(statistic), statistic).any()
    assert raised <= 5  # one in a thousand is allowed; six and more of that have a chance of 1e-3


def test_a_gross_error_stands_apart_among_unequal_views() -> None:
    statistic = np.array([0.2, 0.5, 0.7, 1.0, 1.3, 4.0, 11.0, 900.0])
    suspects = statistic > 9
    assert np.flatnonzero(stand_apart(suspects, statistic)).tolist() == [7]
    assert not stand_apart(statistic > 1000, statistic).any()


def test_unsynchronised_poses() -> None:
    from calibrant.data import RobotPoses
    from calibrant.diagnose.doctor import case_of_poses

    X, Z = standard_mounting("eye-in-hand")
    rng = np.random.default_rng(0)
    times = 0.1 * np.arange(60)

    def at(t: Array) -> Array:
        """T_base_gripper on a smooth path in front of the board."""
        angles = np.column_stack([0.3 * np.sin(1.1 * t), 0.25 * np.cos(0.7 * t), 0.4 * np.sin(0.5 * t)])
        place = np.column_stack([0.05 * np.sin(0.9 * t), 0.05 * np.cos(1.3 * t), 0.5 + 0.05 * np.sin(0.6 * t)])
        return gripper_poses("eye-in-hand", X, Z, se3.make(so3.exp(angles), place))

    B = target_poses("eye-in-hand", X, Z, at(times))
    B = se3.retract(B, rng.normal(size=(60, 6)) * [1e-4] * 6)
    for delay, expected in ((0.04, ["unsynchronised"]), (0.0, [])):
        case = case_of_poses(
            RobotPoses(tuple(str(1e9 + t) for t in times), at(times - delay)), B, setup="eye-in-hand", times=times
        )
        found = examine(case)
        assert names(found) == expected
        if expected:
            measured = found.findings[0].measured
            assert measured is not None
            # Velocities from neighbours 0.1 s away are good to some per cent on this path.
            assert measured.value == pytest.approx(delay, abs=0.003)


@pytest.mark.parametrize("scene", ["parallel-axes", "pure-translation", "two-poses"])
def test_degenerate_motions_by_name_with_the_cure(pairs: CaseOf, scene: str) -> None:
    found = examine(pairs(hand_eye_scene(scene)))
    assert names(found) == ["poses" if scene == "two-poses" else scene]
    assert found.findings[0].status == "fail"
    cure = {"two-poses": "add poses", "parallel-axes": "tilt the gripper", "pure-translation": "turn the gripper"}
    assert cure[scene] in found.findings[0].message
    assert not found.sound


@pytest.mark.parametrize(
    ("given", "words"),
    [(2.0, "two circles of one row"), (2**0.5, "to the nearest"), (0.5, "half of the distance"), (1.7, None)],
)
def test_another_distance_than_that_of_rows_for_the_spacing_of_circles(
    views: CaseOf, given: float, words: str | None
) -> None:
    scene = hand_eye_scene("good", views=15)
    seen = tuple(replace(v, points=given * v.points) for v in scene.observations.views)
    spec = f"circles:4x11:{20 * given!r}mm:asymmetric"
    case = views(replace(scene, observations=replace(scene.observations, views=seen, target=spec)))
    (finding,) = size.examine(case)
    assert finding.status == "fail"
    assert ("which is the distance of two rows" in finding.message) == (words is not None)
    if words is not None:
        assert words in finding.message
        assert "--target circles:4x11:20mm:asymmetric" in finding.proposal


def test_faults_together(pairs: CaseOf) -> None:
    scene = hand_eye_scene("good", views=20)
    T = scene.robot_poses.T_base_gripper.copy()
    B = scene.measured_T_camera_target.copy()
    B[4] = flipped_board(scene.points, B[4])
    B[:, :3, 3] *= 1.05
    wrong = T.copy()
    wrong[[11, 17]] = T[[17, 11]]
    found = examine(pairs(scene, T=np.roll(wrong, 1, axis=0), B=B))
    assert sorted(names(found)) == ["board-flipped", "poses-shifted", "poses-swapped", "target-size"]
    assert found.named("target-size")[0].measured.value == pytest.approx(1 / 1.05, abs=0.003)  # type: ignore[union-attr]
    undone(found, T)


@pytest.mark.parametrize(
    ("unit", "words"),
    [(0.0254, "inches instead of m, or poses in inches were read in m"), (10, "mm instead of cm"), (100, "cm instead")],
)
def test_two_units_are_told_by_their_ratio(pairs: CaseOf, unit: float, words: str) -> None:
    factor = min(unit, 1 / unit)
    message = examine(pairs(hand_eye_scene("good")).scaled(factor)).named("target-size")[0].message
    assert words in message


def test_positions_in_other_axes_than_the_rotations_are_told(pairs: CaseOf) -> None:
    T = hand_eye_scene("good").robot_poses.T_base_gripper.copy()
    T[:, :3, 3] = T[:, [1, 0, 2], 3]
    found = examine(pairs(T=T))
    assert names(found) == ["no-agreement"]
    assert "the rotations agree" in found.findings[0].message


def test_poses_of_another_session_fit_nothing(pairs: CaseOf) -> None:
    T = hand_eye_scene("good", seed=5).robot_poses.T_base_gripper
    found = examine(pairs(T=T))
    assert not found.sound
    assert names(found) == ["no-agreement"]


@pytest.mark.statistics
def test_few_clean_poses_raise_no_alarm_of_a_move(pairs: CaseOf) -> None:
    alarms = []
    for seed in range(5100, 5160):
        scene = hand_eye_scene("good", setup=("eye-in-hand", "eye-to-hand")[seed % 2], seed=seed, views=8)
        names = [f.name for f in examine(pairs(scene)).findings if f.status == "fail"]
        alarms += [(seed, name) for name in names]
    # One in a thousand is the chance allowed; with both noise levels taken for one it was one in fifty.
    assert alarms == []
