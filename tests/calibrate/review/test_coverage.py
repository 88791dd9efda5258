"""Coverage of the image and of the board's poses: the figures, and the view that is missing by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.calibrate.review.corners import corner_sigmas
from calibrant.calibrate.review.coverage import (
    board_spread,
    camera_coverage,
    coverage_checks,
    image_coverage,
    spread_checks,
    with_coverage_checks,
)
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Check, Observations, ViewResult
from calibrant.data.results import Verdict
from calibrant.errors import InputError
from calibrant.geometry import se3, so3

SIZE = (1200, 900)


def _grid(x0: float, y0: float, x1: float, y1: float) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(x0, x1, 40), np.linspace(y0, y1, 40))
    return np.stack([x.ravel(), y.ravel()], axis=-1)


def test_a_full_image_passes() -> None:
    coverage = image_coverage([_grid(-0.5, -0.5, 1199.5, 899.5)], image_size=SIZE)
    assert coverage.occupied == 1.0
    assert coverage.counts.sum() == 1600
    assert [c.status for c in coverage_checks(coverage)] == ["ok", "ok"]


@pytest.mark.parametrize(
    ("corner", "views"),
    [
        ("lower left", [_grid(0, 0, 1199, 700), _grid(300, 500, 1199, 899)]),
        ("upper right", [_grid(0, 200, 1199, 899), _grid(0, 0, 900, 400)]),
    ],
)
def test_the_empty_corner_is_named(corner: str, views: list[np.ndarray]) -> None:
    coverage = image_coverage(views, image_size=SIZE)
    assert coverage.empty_corners == (corner,)
    check = coverage_checks(coverage)[1]
    assert check.status == "warn"
    assert f"no points in the {corner} corner: take a view with the board there" in check.message
    assert check.value == 3


def test_the_emptiest_half_is_named() -> None:
    checks = coverage_checks(image_coverage([_grid(700, 0, 1199, 899)], image_size=SIZE))
    assert checks[0].status == "warn"
    assert "left half" in checks[0].message
    assert "upper left and the lower left corners" in checks[1].message


def test_only_the_middle_leaves_four_corners() -> None:
    check = coverage_checks(image_coverage([_grid(500, 400, 700, 500)], image_size=SIZE))[1]
    assert "four corners" in check.message


def test_no_view_is_an_input_error() -> None:
    with pytest.raises(InputError, match="at least one view"):
        image_coverage([], image_size=SIZE)
    with pytest.raises(InputError, match="at least one view"):
        board_spread([], [])


def _boards(tilts_deg: list[tuple[float, float]], distances: list[float]) -> list[np.ndarray]:
    """Boards tilted about the camera's x and y by these angles, their origin on the axis at these distances."""
    return [
        se3.make(so3.exp(np.deg2rad([ax, ay, 0.0])), [0, 0, z])
        for (ax, ay), z in zip(tilts_deg, distances, strict=True)
    ]


def test_tilt_and_distance_are_measured() -> None:
    T = _boards([(0, 0), (30, 0), (0, -40), (0, 25)], [0.5, 0.6, 0.7, 0.8])
    spread = board_spread(T, [np.zeros(3)] * 4)
    np.testing.assert_allclose(spread.tilt_deg, [0, 30, 40, 25], atol=1e-9)
    np.testing.assert_allclose(spread.distance, [0.5, 0.6, 0.7, 0.8])
    tilt, distance = spread_checks(spread)
    assert (tilt.status, distance.status) == ("ok", "ok")
    assert distance.message == "the board stood 500 to 800 mm from the camera"


def test_a_board_seen_from_behind_its_z_axis_counts_the_same() -> None:
    T = se3.make(so3.exp([np.pi - np.deg2rad(30), 0, 0]), [0, 0, 0.5])
    np.testing.assert_allclose(board_spread([T], [np.zeros(3)]).tilt_deg, [30], atol=1e-9)


def test_parallel_boards_are_warned_about() -> None:
    tilt, distance = spread_checks(board_spread(_boards([(3, 0), (0, 5), (2, 2)], [0.5, 0.5, 0.52]), [np.zeros(3)] * 3))
    assert tilt.status == "warn"
    assert "0 of 3 views by 20 deg or more" in tilt.message
    assert distance.status == "warn"


@pytest.mark.parametrize(
    ("tilts", "missing"),
    [([(30, 0), (-35, 1), (25, 0)], "left or right"), ([(0, 30), (1, -35), (0, 25)], "up or down")],
)
def test_tilts_about_one_axis_name_the_other(tilts: list[tuple[float, float]], missing: str) -> None:
    tilt = spread_checks(board_spread(_boards(tilts, [0.4, 0.5, 0.6]), [np.zeros(3)] * 3))[0]
    assert tilt.status == "warn"
    assert f"tilted {missing} as well" in tilt.message


CAMERA = Camera.create("pinhole", {"fx": 900, "fy": 900, "cx": 600, "cy": 450}, image_size=SIZE)
BOARD = np.stack([*(g.ravel() * 0.03 for g in np.meshgrid(np.arange(9.0), np.arange(6.0))), np.zeros(54)], axis=-1)


def _result(*, verdict: Verdict = "ok", checks: tuple[Check, ...] = ()) -> CalibrationResult:
    """Boards in the left half of the image, tilted about one axis only; the last one was left out."""
    T = [se3.make(so3.exp([np.deg2rad(a), 0, 0]), [-0.35, -0.07, z]) for a, z in ((30, 0.6), (-35, 0.7), (25, 0.5))]
    uv = [CAMERA.project(se3.apply(pose, BOARD)) for pose in T]
    observations = Observations.from_points([BOARD] * 3, uv, image_size=SIZE)
    views = tuple(ViewResult(str(i), i < 2, 54, T_camera_target=pose) for i, pose in enumerate(T))
    return CalibrationResult(
        "intrinsics", verdict, checks=checks, cameras={"camera": CAMERA}, views=views, observations=observations
    )


def test_a_result_tells_its_own_coverage_from_the_views_it_used() -> None:
    (found,) = camera_coverage(_result())
    assert found.coverage.counts.sum() == 108  # 54 points of two views; the third was left out
    names = ["image-coverage", "corner-coverage", "tilt-range", "distance-range", "residual-structure"]
    assert [check.name for check in found.checks] == names
    assert "take views with the board in the right half" in found.checks[0].message
    assert "tilted left or right as well" in found.checks[2].message


def test_coverage_checks_are_added_once_and_count_for_the_verdict() -> None:
    own = Check("tilt-range", "ok", "the calibration's own words")
    result = with_coverage_checks(_result(checks=(own,)))
    assert result.verdict == "warn"
    assert result.check("tilt-range") is own
    assert result.check("image-coverage").status == "warn"
    assert with_coverage_checks(result).checks == result.checks
    assert with_coverage_checks(_result(verdict="refused")).verdict == "refused"


def test_a_result_without_observations_has_no_coverage() -> None:
    bare = CalibrationResult("intrinsics", "ok")
    assert camera_coverage(bare) == ()
    assert with_coverage_checks(bare).verdict == "ok"


def test_a_corner_that_the_other_views_determine_needs_no_view() -> None:
    """The lower left is empty: a sigma below 1 % of the focal length is said, one above warns, no ray there is none."""
    coverage = image_coverage([_grid(0, 0, 1199, 700), _grid(300, 500, 1199, 899)], image_size=SIZE)
    known = coverage_checks(coverage, {"lower left": 0.004})[1]
    assert (known.status, known.value) == ("ok", 3)
    assert "no points in the lower left corner; the lens is known there to 0.4 % of the focal length" in known.message
    unknown = coverage_checks(coverage, {"lower left": 0.03})[1]
    assert unknown.status == "warn"
    assert "lower left corner, where the lens is known to 3 % of the focal length only" in unknown.message
    assert coverage_checks(coverage, {"lower left": float("nan")})[1].message == "no points in the lower left corner"


@pytest.mark.statistics
def test_the_sigma_of_a_corner_is_what_lenses_drawn_from_the_covariance_scatter() -> None:
    """Each lens turned so that it fits the seen points best, as the pose of what it looks at would be."""
    names = ("fx", "fy", "cx", "cy")
    sigma = np.diag([2.0, 2.0, 3.0, 3.0])
    camera = replace(CAMERA, covariance=sigma @ (np.eye(4) + 0.3) @ sigma)
    seen = np.stack([*(g.ravel() for g in np.meshgrid(np.linspace(-0.2, 0.2, 9), np.linspace(-0.2, 0.2, 9)))], axis=-1)
    seen = np.column_stack([seen, np.ones(81)])
    found = corner_sigmas(camera, seen, ("upper left", "lower right"))
    rng = np.random.default_rng(0)
    corner = camera.unproject([[0.0, 0.0]])
    moved = []
    for draw in rng.multivariate_normal(np.zeros(4), np.asarray(camera.covariance), size=300):
        other = Camera.create(
            "pinhole", {n: v + d for n, v, d in zip(names, CAMERA.values, draw, strict=True)}, image_size=SIZE
        )
        J = np.concatenate([-_turned(other, p) for p in seen])
        off = (other.project(seen) - camera.project(seen)).ravel()
        turn = so3.exp(np.linalg.lstsq(J, off, rcond=None)[0])
        moved.append((other.project(corner @ turn.T) - camera.project(corner))[0])
    worst = np.sqrt(np.linalg.eigvalsh(np.cov(np.array(moved).T))[-1])
    assert found["upper left"] == pytest.approx(worst, rel=0.15)


def _turned(camera: Camera, point: np.ndarray) -> np.ndarray:
    """d pixel / d turn at a point, by differences, (2, 3)."""
    h = 1e-6
    return np.stack(
        [
            (camera.project(so3.exp(h * e) @ point) - camera.project(so3.exp(-h * e) @ point)) / (2 * h)
            for e in np.eye(3)
        ],
        axis=-1,
    )
