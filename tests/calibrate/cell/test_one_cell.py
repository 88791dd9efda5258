"""Targets moved by hand beside robots: what one observation says of one component tightens every other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from calibrant.calibrate.cell.calibrate import calibrate_cell
from calibrant.calibrate.cell.problem.layout import HANDHELD, Pictures
from calibrant.calibrate.cell.rig import calibrate_rig
from calibrant.calibrate.cell.stated import stated_layout
from calibrant.calibrate.reprojection.links import Link, link_maps
from calibrant.calibrate.stereo.calibrate import calibrate_stereo
from calibrant.data import CalibrationResult, Observations, RobotPoses, View
from calibrant.diagnose.budget.cell import error_budget
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.scenes import grid, gripper_poses, look_at_board, standard_camera, standard_mounting
from calibrant.simulate.truth import normalised

CAMERA, POINTS = standard_camera(), grid(9, 7, 0.02)
X_LEFT, Z_TABLE = standard_mounting("eye-in-hand")
T_LEFT_RIGHT = se3.make(so3.exp([0.02, -0.06, 0.05]), [0.06, 0.005, 0.0])
X_RIGHT = X_LEFT @ T_LEFT_RIGHT
X_TOP, Z_GRIPPER = standard_mounting("eye-to-hand")
T_TOP_SIDE = se3.make(so3.exp([0.02, 0.3, 0.05]), [-0.25, 0.02, 0.05])
KNOWN = replace(CAMERA, covariance=np.diag(np.full(len(CAMERA.values), 1e-12)))
"""Known to next to nothing: what one part says of it is no news to the other."""
BOTH = {"left": KNOWN, "right": KNOWN}


def views(camera: str, T: np.ndarray, rng: np.random.Generator, *, sigma: float, name: str = "") -> Observations:
    """What a camera sees of boards at T (n, 4, 4); views of fewer than 12 points are none."""
    out = []
    for k, M in enumerate(T):
        uv = CAMERA.project(se3.apply(M, POINTS)) + sigma * rng.normal(size=(len(POINTS), 2))
        inside = np.all(np.isfinite(uv) & (uv > 0) & (uv < np.array(CAMERA.image_size) - 1), axis=1)
        if inside.sum() >= 12:
            ids = np.flatnonzero(inside)
            out.append(View(f"{name}{k}", POINTS[inside], uv[inside], ids, camera, moment=f"{name}{k}"))
    return Observations(tuple(out), {camera: CAMERA.image_size})


def wrist(
    seed: int, *, sigma: float = 0.1, mm: float = 0.2, deg: float = 0.03, right: int = 14, by_hand: int = 14
) -> tuple[RobotPoses, list[Pictures]]:
    """A stereo head in a gripper: `right` of 14 poses have a picture of the right camera; boards held before both."""
    rng = np.random.default_rng(seed)
    B = look_at_board(CAMERA, POINTS, 14, rng=rng, distance=(0.4, 0.7), tilt_deg=35)
    T = gripper_poses("eye-in-hand", X_LEFT, Z_TABLE, B)
    lists = [
        Pictures("left", "eye-in-hand", views("left", B, rng, sigma=sigma)),
        Pictures("right", "eye-in-hand", views("right", (se3.inverse(T_LEFT_RIGHT) @ B)[:right], rng, sigma=sigma)),
    ]
    held = look_at_board(CAMERA, POINTS, by_hand, rng=rng, distance=(0.4, 0.6), tilt_deg=35)
    for name, T_left in (("left", np.eye(4)), ("right", T_LEFT_RIGHT)):
        seen = views(name, se3.inverse(T_left) @ held, rng, sigma=sigma)
        lists.append(Pictures(name, HANDHELD, seen, target="held"))
    return RobotPoses.from_matrices(noisy_poses(T, sigma_mm=mm, sigma_deg=deg, rng=rng)), lists


def standing(seed: int, *, sigma: float = 0.1) -> tuple[RobotPoses, list[Pictures]]:
    """A robot that shows a board to the camera on top; the one at the side sees boards held by hand alone."""
    rng = np.random.default_rng(seed)
    B = look_at_board(CAMERA, POINTS, 12, rng=rng, distance=(0.5, 0.9), tilt_deg=35)
    T = gripper_poses("eye-to-hand", X_TOP, Z_GRIPPER, B)
    held = look_at_board(CAMERA, POINTS, 14, rng=rng, distance=(0.7, 0.9), tilt_deg=25)
    lists = [
        Pictures("top", "eye-to-hand", views("top", B, rng, sigma=sigma)),
        Pictures("top", HANDHELD, views("top", held, rng, sigma=sigma)),
        Pictures("side", HANDHELD, views("side", se3.inverse(T_TOP_SIDE) @ held, rng, sigma=sigma)),
    ]
    mm, deg = (0.2, 0.03) if sigma else (0.0, 0.0)
    return RobotPoses.from_matrices(noisy_poses(T, sigma_mm=mm, sigma_deg=deg, rng=rng)), lists


def test_exact_without_noise() -> None:
    poses, lists = wrist(0, sigma=0.0, mm=0.0, deg=0.0, right=2)
    result = calibrate_cell(poses, lists, cameras=BOTH)
    np.testing.assert_allclose(result.transform("gripper", "left").matrix, X_LEFT, atol=1e-7)
    np.testing.assert_allclose(result.transform("gripper", "right").matrix, X_RIGHT, atol=1e-7)
    poses, lists = standing(0, sigma=0.0)
    result = calibrate_cell(poses, lists, cameras={"top": CAMERA, "side": CAMERA})
    np.testing.assert_allclose(result.transform("base", "side").matrix, X_TOP @ T_TOP_SIDE, atol=1e-7)


def sigma_mm(result: CalibrationResult, *frame: str) -> float:
    return float(np.linalg.norm(result.transform(*frame).sigma_translation_mm))


ONCE = np.zeros(1, dtype=np.int64)
BETWEEN = np.concatenate(
    [M[0] for M in link_maps([Link("left", ONCE, inverted=True), Link("right", ONCE)], [X_LEFT[None], X_RIGHT[None]])],
    axis=1,
)
"""(6, 12): how T_left_right answers errors of both cameras in the gripper."""


def by_both(hand_eye: CalibrationResult, stereo: CalibrationResult) -> np.ndarray:
    """Covariance (12, 12) of both cameras in the gripper by two parts that are independent: their information adds."""
    joint = hand_eye.joint_covariance
    assert joint is not None
    rows = [joint.frames.index(("gripper", camera)) for camera in ("left", "right")]
    at = [6 * row + k for row in rows for k in range(6)]
    of_stereo = np.linalg.inv(stereo.transform("left", "right").covariance)
    return np.linalg.inv(np.linalg.inv(joint.matrix[np.ix_(at, at)]) + BETWEEN.T @ of_stereo @ BETWEEN)


def mm(C: np.ndarray) -> float:
    return 1e3 * float(np.sqrt(np.trace(C[3:, 3:])))


@pytest.mark.parametrize("seed", [3, pytest.param(2, marks=pytest.mark.long)])
def test_a_camera_that_hand_eye_tells_poorly_and_stereo_well_has_the_sigma_of_both(seed: int) -> None:
    """Of seed 2 the motion alone says the board on the table is 1.6 sigma larger; the pair knows that it is not."""
    poses, lists = wrist(seed, right=4)
    whole = calibrate_cell(poses, lists, cameras=BOTH)
    hand_eye = calibrate_cell(poses, lists[:2], cameras=BOTH)
    stereo = calibrate_cell({}, lists[2:], cameras=BOTH)
    both = by_both(hand_eye, stereo)
    # Each fit estimates its own noise levels, a robot's from 14 poses to a tenth of itself: 8 per cent of the sigma.
    assert sigma_mm(whole, "gripper", "right") == pytest.approx(mm(both[6:, 6:]), rel=0.08)
    assert sigma_mm(whole, "left", "right") == pytest.approx(mm(BETWEEN @ both @ BETWEEN.T), rel=0.08)
    assert sigma_mm(whole, "left", "right") < 0.25 * sigma_mm(hand_eye, "left", "right")
    assert sigma_mm(whole, "left", "right") < 0.85 * sigma_mm(stereo, "left", "right")
    # By stereo the right camera is known in the gripper as the left one is.
    alone = [sigma_mm(hand_eye, "gripper", camera) for camera in BOTH]
    together = [sigma_mm(whole, "gripper", camera) for camera in BOTH]
    assert together[1] - together[0] < 0.2 * (alone[1] - alone[0])
    assert {whole.check(name).status for name in ("shared-moments", "rigidity", "together-right")} == {"ok"}
    assert whole.options["setup"] == {"left": "eye-in-hand", "right": "eye-in-hand"}


def test_a_camera_that_sees_boards_held_by_hand_alone_is_placed_by_the_others() -> None:
    poses, lists = standing(1)
    result = calibrate_cell(poses, lists)
    assert normalised(result.transform("base", "side"), X_TOP @ T_TOP_SIDE) / 6 < 4
    assert normalised(result.transform("top", "side"), T_TOP_SIDE) / 6 < 4
    assert result.joint_covariance is not None
    assert result.joint_covariance.frames == (("base", "top"), ("base", "side"), ("gripper", "gripper_target"))
    assert result.joint_covariance.cameras == ("top", "side")
    again = stated_layout(result)
    assert again is not None
    ids = [[v.moment for v in p.seen.views] for p in again.pictures if p.seen is not None]
    assert ids == [[v.moment for v in p.seen.views] for p in lists if p.seen is not None]


@pytest.mark.statistics
def test_errors_of_all_places_match_their_covariance() -> None:
    scores: dict[str, list[float]] = {}
    for seed in range(12):
        poses, lists = wrist(100 + seed, right=4, by_hand=8)
        result = calibrate_cell(poses, lists, cameras=BOTH)
        for frame, T in (
            (("gripper", "right"), X_RIGHT), (("left", "right"), T_LEFT_RIGHT), (("base", "target"), Z_TABLE)
        ):  # fmt: skip
            scores.setdefault(frame[1] + frame[0], []).append(normalised(result.transform(*frame), T))
        poses, lists = standing(200 + seed)
        result = calibrate_cell(poses, lists, cameras={"top": KNOWN, "side": KNOWN})
        scores.setdefault("side", []).append(normalised(result.transform("base", "side"), X_TOP @ T_TOP_SIDE))
    # Means of 12 values of deviation sqrt(12): 6 +- 1; three sigmas allowed.
    assert {name: np.mean(values) for name, values in scores.items() if not 3.0 < np.mean(values) < 9.0} == {}


def test_moments_that_are_none_are_left_out_beside_robots_too() -> None:
    poses, lists = standing(2)
    seen = lists[2].seen
    assert seen is not None
    moved = list(seen.views)
    other = se3.make(so3.exp([0.0, 0.05, 0.0]), [0.02, 0.0, 0.0])
    rng = np.random.default_rng(0)
    held = look_at_board(CAMERA, POINTS, 1, rng=rng, distance=(0.7, 0.9), tilt_deg=25)
    fake = views("side", se3.inverse(T_TOP_SIDE @ other) @ held, rng, sigma=0.1).views[0]
    moved[5] = replace(fake, id=moved[5].id, moment=moved[5].moment)
    lists[2] = replace(lists[2], observations=replace(seen, views=tuple(moved)))
    result = calibrate_cell(poses, lists, cameras={"top": KNOWN, "side": KNOWN})
    assert moved[5].id in [v.id for v in result.views if not v.used and "do not show the board" in (v.reason or "")]
    assert result.check("at-once").status == "warn"


def test_cameras_on_two_bodies_are_not_tied_by_one_target() -> None:
    poses, lists = wrist(4)
    onlooker = Pictures("top", HANDHELD, lists[2].observations, target="held")
    standing_too = Pictures("top", "standing", lists[2].observations, target="held")
    seen = lists[2].seen
    assert seen is not None
    with pytest.raises(InputError, match="only cameras that stand still to each other are tied by it"):
        calibrate_cell(poses, [*lists, onlooker, standing_too], cameras={**BOTH, "top": CAMERA})
    with pytest.raises(RefusedError, match="nothing tells where third is in base"):
        calibrate_cell(poses, [*lists[:2], replace(lists[3], camera="third")], cameras=BOTH)
    far = replace(seen, views=tuple(replace(v, moment=f"other {v.moment}") for v in seen.views))
    with pytest.raises(RefusedError, match="saw the target at no moment together"):
        calibrate_cell(poses, [*lists[:3], replace(lists[3], observations=far, camera="third")], cameras=BOTH)


@pytest.mark.parametrize("door", [calibrate_rig, calibrate_stereo])
def test_rigs_and_stereo_are_cells_digit_for_digit(door: Callable[[Observations], CalibrationResult]) -> None:
    lists = wrist(6)[1][2:]
    left, right = (p.seen for p in lists)
    assert left is not None
    assert right is not None
    both = Observations((*left.views, *right.views), {**left.image_sizes, **right.image_sizes})
    first, second = door(both), calibrate_cell({}, lists)
    np.testing.assert_array_equal(
        first.transform("left", "right").covariance, second.transform("left", "right").covariance
    )
    np.testing.assert_array_equal(first.transform("left", "right").matrix, second.transform("left", "right").matrix)
    for name in BOTH:
        np.testing.assert_array_equal(first.cameras[name].values, second.cameras[name].values)


def test_a_board_on_the_table_and_in_a_hand_is_two_frames_of_one_size() -> None:
    poses, lists = wrist(7, right=4)
    lists = [replace(p, target="board") for p in lists]
    result = calibrate_cell(poses, lists, cameras=BOTH)
    assert normalised(result.transform("base", "base_board"), Z_TABLE) / 6 < 4
    with pytest.raises(InputError, match="moved by hand"):
        error_budget(result)
