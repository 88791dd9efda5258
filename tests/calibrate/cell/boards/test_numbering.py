"""Boards that look the same turned: numbered by the robot's motion, left alone where it says nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant.calibrate.cell.boards.numbering import find_numbering
from calibrant.calibrate.cell.boards.turned import NAME, board_turns, turned_views, with_boards
from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.calibrate.cell.problem.views import from_observations
from calibrant.data import Observations, RobotPoses
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.scenes import Setup, gripper_poses, look_at_board, observe, standard_camera, standard_mounting
from calibrant.simulate.truth import normalised
from calibrant.targets.registry import parse_target

Array = NDArray[np.float64]
CIRCLES = "circles:9x7:30mm"


def rotations(n: int, seed: int, *, noise_deg: float = 0.2) -> tuple[Array, Array]:
    """R_A and R_B of an ordinary cell that sees its board from all sides, numbered rightly."""
    rng = np.random.default_rng(seed)
    X, Z = standard_mounting("eye-in-hand")
    points = parse_target(CIRCLES).points
    B = look_at_board(standard_camera(), points, n, rng=rng, distance=(0.45, 0.9), tilt_deg=35)
    A = noisy_poses(gripper_poses("eye-in-hand", X, Z, B), sigma_mm=0.0, sigma_deg=noise_deg, rng=rng)
    return A[:, :3, :3], B[:, :3, :3]


def turns(steps: NDArray[np.intp], order: int) -> Array:
    return so3.exp(2 * np.pi / order * steps[:, None] * [0.0, 0.0, 1.0])


@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize("n", [8, 25, 150])
@pytest.mark.parametrize("inverse", [False, True])
def test_random_numbering_becomes_consistent_without_a_majority(order: int, n: int, inverse: bool) -> None:
    R_A, R_B = rotations(n, seed=n)
    steps = np.random.default_rng(order).integers(0, order, n)
    sides = [np.swapaxes(R_A, 1, 2), R_A] if inverse else [R_A]
    found = find_numbering(sides, R_B @ turns(steps, order), order)
    assert found.verdict == "turned"
    assert len(set(((found.steps + steps) % order).tolist())) == 1
    assert found.turned_deg < 1.0 < 30.0 < found.given_deg
    # Most views keep their number: the numbering of all together means nothing.
    assert np.bincount(found.steps, minlength=order).argmax() == 0


def test_views_turned_by_quarters_exactly_are_told_by_their_axes() -> None:
    """Boards turned by 0, 90, 180, 270 degrees: a quarter turn has the same angle under both numberings."""
    rng = np.random.default_rng(3)
    n = 16
    tilt = np.deg2rad(25) * rng.normal(size=(n, 3)) * [1.0, 1.0, 0.0]
    R_B = so3.exp(tilt) @ turns(np.arange(n) % 4, 4)
    X, Z = (T[:3, :3] for T in standard_mounting("eye-in-hand"))
    R_A = Z @ np.swapaxes(R_B, 1, 2) @ X.T
    steps = rng.integers(0, 2, n)
    found = find_numbering([R_A], R_B @ turns(steps, 2), 2)
    assert found.verdict == "turned"
    assert len(set(((found.steps + steps) % 2).tolist())) == 1


@pytest.mark.parametrize("order", [2, 4])
def test_right_numbering_stays_even_with_bad_poses(order: int) -> None:
    for seed in range(10):
        R_A, R_B = rotations(12, seed=seed)
        R_A[:3] = R_A[:3] @ so3.exp(np.deg2rad([[40.0, 10.0, 0.0], [0.0, -35.0, 9.0], [15.0, 0.0, 30.0]]))
        found = find_numbering([R_A, np.swapaxes(R_A, 1, 2)], R_B, order)
        assert found.verdict == "given"
        assert not found.steps.any()


def test_bad_poses_do_not_hide_the_numbering() -> None:
    R_A, R_B = rotations(15, seed=5)
    steps = np.random.default_rng(1).integers(0, 2, 15)
    R_A[:3] = R_A[:3] @ so3.exp(np.deg2rad([[40.0, 10.0, 0.0], [0.0, -35.0, 9.0], [15.0, 0.0, 30.0]]))
    found = find_numbering([R_A], R_B @ turns(steps, 2), 2)
    assert found.verdict == "turned"
    assert len(set(((found.steps + steps) % 2)[3:].tolist())) == 1


def test_poses_of_other_pictures_are_not_renumbered() -> None:
    """Bonferroni over all numberings: one of n views in two ways is no evidence by itself."""
    for seed in range(10):
        R_A, R_B = rotations(10, seed=seed)
        found = find_numbering([R_A[np.random.default_rng(seed).permutation(10)]], R_B, 2)
        assert found.verdict != "turned"


def test_fewer_than_three_views_stay() -> None:
    R_A, R_B = rotations(2, seed=0)
    assert find_numbering([R_A], R_B @ turns(np.array([0, 1]), 2), 2).verdict == "given"


@pytest.mark.parametrize(
    ("spec", "count"),
    [
        (CIRCLES, 2),
        ("circles:7x7:30mm", 4),
        ("circles:7x7:30mm:bigdot", None),
        ("circles:4x11:20mm:asymmetric", None),
        ("circles:4x10:20mm:asymmetric", 2),
        ("chessboard:9x7:30mm", 2),
        ("chessboard:9x6:30mm", None),
        ("chessboard:8x8:30mm", 4),
        ("charuco:8x6:30mm:22mm:DICT_5X5_100", None),
        (None, None),
    ],
)
def test_turns_map_the_board_onto_itself(spec: str | None, count: int | None) -> None:
    found = board_turns(spec)
    assert (None if found is None else len(found.F)) == count
    if found is None or spec is None:
        return
    points = parse_target(spec).points
    moved = se3.apply(found.F[1], points)
    nearest = np.linalg.norm(moved[:, None] - points, axis=2).min(axis=1)
    assert nearest.max() < 1e-12


def test_turned_views_are_the_board_numbered_from_the_other_end() -> None:
    camera, target, F = standard_camera(), parse_target(CIRCLES), board_turns(CIRCLES)
    assert F is not None
    rng = np.random.default_rng(0)
    B = look_at_board(camera, target.points, 3, rng=rng)
    seen = observe(camera, target.points, B, sigma_px=0.2, rng=rng)
    poses = RobotPoses([v.id for v in seen.views], B)
    data = from_observations(poses, seen, camera)
    turned = with_boards(data, [1], F.F[1])
    assert turned.views is not None
    # Points and ids of a whole board run backwards; the image stays.
    view, old = turned.views[1], seen.views[1]
    np.testing.assert_array_equal(view.point_ids, old.point_ids[::-1])
    np.testing.assert_allclose(view.points, old.points[::-1], atol=1e-12)
    again = from_observations(poses, replace(seen, views=turned.views), camera)
    # The solver of the pose stops when its steps are below a thousandth of sigma.
    np.testing.assert_allclose(turned.B, again.B, atol=1e-6)
    scale = np.sqrt(np.einsum("nii->ni", again.covariance))
    np.testing.assert_allclose(
        turned.covariance / scale[:, :, None] / scale[:, None], again.covariance / scale[:, :, None] / scale[:, None],
        atol=1e-3,
    )  # fmt: skip


def photos(setup: Setup, spec: str, n: int, seed: int) -> tuple[RobotPoses, Observations, Array]:
    """Poses and views of a board numbered from any end, with the true X."""
    rng = np.random.default_rng(seed)
    target, camera, (X, Z) = parse_target(spec), standard_camera(), standard_mounting(setup)
    B = look_at_board(camera, target.points, n, rng=rng, distance=(0.45, 0.9), tilt_deg=35)
    A = noisy_poses(gripper_poses(setup, X, Z, B), sigma_mm=0.2, sigma_deg=0.05, rng=rng)
    found = board_turns(target.spec)
    assert found is not None
    steps = rng.integers(0, len(found.F), n)
    rows = np.flatnonzero(steps)
    seen = observe(camera, target.points, B, sigma_px=0.2, rng=rng)
    views = turned_views(seen.views, rows, found.F[steps[rows]])
    return RobotPoses([v.id for v in views], A), replace(seen, views=views, target=target.spec), X


@pytest.mark.parametrize(
    ("setup", "spec", "known"),
    [("eye-in-hand", CIRCLES, True), ("eye-to-hand", "chessboard:8x8:30mm", True), ("eye-to-hand", CIRCLES, False)],
)
def test_calibration_from_boards_numbered_from_any_end(setup: Setup, spec: str, known: bool) -> None:
    poses, seen, X = photos(setup, spec, 15, seed=4)
    result = calibrate_hand_eye(poses, seen, setup=setup, camera=standard_camera() if known else None)
    check = result.check(NAME)
    assert check.status == "ok"
    assert "of 15 views were numbered again" in check.message
    assert sum(v.used for v in result.views) == 15
    found = result.transforms[0]
    # chi-square of 6 degrees of freedom at P = 1e-4.
    assert normalised(found, X) < 27.86
    # What the result keeps is numbered so, and stays: nothing is left to be said of it.
    assert result.observations is not None
    again = calibrate_hand_eye(poses, result.observations, setup=setup, camera=standard_camera() if known else None)
    assert NAME not in [c.name for c in again.checks]
    np.testing.assert_allclose(again.transforms[0].matrix, found.matrix, atol=1e-6)


def three_ambiguous() -> Array:
    """R_B of two views tilted both ways and one rolled by 90 degrees: half a turn of the third changes no angle."""
    return so3.exp(np.deg2rad([[20.0, 0.0, 0.0], [-20.0, 0.0, 0.0], [0.0, 0.0, 90.0]]))


def test_more_than_one_numbering_is_left_open_and_refused() -> None:
    X, Z = standard_mounting("eye-in-hand")
    target, camera = parse_target(CIRCLES), standard_camera()
    R_B = three_ambiguous()
    middle = 0.5 * (target.points.min(axis=0) + target.points.max(axis=0))
    B = se3.make(R_B, np.array([[0.05, 0.0, 0.6], [-0.05, 0.02, 0.6], [0.0, -0.03, 0.5]]) - R_B @ middle)
    A = gripper_poses("eye-in-hand", X, Z, B)
    found = find_numbering([A[:, :3, :3]], R_B @ turns(np.array([0, 1, 0]), 2), 2)
    assert found.verdict == "open"
    assert not found.steps.any()
    F = board_turns(CIRCLES)
    assert F is not None
    seen = observe(camera, target.points, B, sigma_px=0.01, rng=np.random.default_rng(0))
    seen = replace(seen, views=turned_views(seen.views, [1], F.F[1]), target=CIRCLES)
    poses = RobotPoses([v.id for v in seen.views], A)
    with pytest.raises(RefusedError, match="more than one other numbering would"):
        calibrate_hand_eye(poses, seen, setup="eye-in-hand", camera=camera)
