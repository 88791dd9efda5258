"""Projectors: exact on exact data whatever the lens shift, honest on noisy data, clear about what nothing tells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.calibrate.cell.lit.checks import least_told
from calibrant.calibrate.projector.calibrate import calibrate_projector
from calibrant.data import CalibrationResult, Observations
from calibrant.errors import InputError, RefusedError
from calibrant.simulate.projector.points import ProjectorPair, board_poses, carried_views, example_pair
from calibrant.simulate.scenes import grid
from calibrant.simulate.truth import normalised

POINTS = grid(9, 7, 0.03)
LENSES = {"short": (0.0, 1000.0), "middle": (0.5, 1500.0), "long": (0.5, 2500.0)}


def scene(
    pair: ProjectorPair, seed: int, *, views: int = 12, corner_px: float = 0.05, decoded_px: float = 0.03
) -> Observations:
    rng = np.random.default_rng(seed)
    poses = board_poses(pair, POINTS, views, rng, distance=(0.7, 1.1))
    return carried_views(pair, POINTS, poses, rng, corner_px=corner_px, decoded_px=decoded_px)


@pytest.mark.parametrize("lens", LENSES)
def test_exact_points_give_the_exact_projector(lens: str) -> None:
    """With a lens shift of half the height the principal point lies at the picture's edge or beyond."""
    shift, focal = LENSES[lens]
    pair = example_pair(shift=shift, focal_px=focal)
    result = calibrate_projector(scene(pair, 0, corner_px=0.0, decoded_px=0.0))
    np.testing.assert_allclose(result.cameras["projector"].values, pair.projector.values, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(result.transform("camera", "projector").matrix, pair.T_camera_projector, atol=1e-8)


@pytest.mark.parametrize("lens", LENSES)
def test_focal_length_within_a_thousandth(lens: str) -> None:
    shift, focal = LENSES[lens]
    pair = example_pair(shift=shift, focal_px=focal)
    result = calibrate_projector(scene(pair, 1))
    for name in ("fx", "fy"):
        assert result.cameras["projector"].parameters[name] == pytest.approx(pair.projector.parameters[name], rel=1e-3)
    assert result.kind == "projector"
    assert result.verdict != "refused"


def scores(result: CalibrationResult, pair: ProjectorPair) -> tuple[float, float]:
    """Squared error over the covariance of pose and projector, a degree of freedom; without terms that are left out."""
    projector = result.cameras["projector"]
    error = projector.values - pair.projector.values
    assert projector.covariance is not None
    told = np.flatnonzero(np.diag(projector.covariance))
    lens = float(error[told] @ np.linalg.solve(projector.covariance[np.ix_(told, told)], error[told])) / len(told)
    return normalised(result.transform("camera", "projector"), pair.T_camera_projector) / 6, lens


@pytest.mark.statistics
@pytest.mark.parametrize("lens", LENSES)
def test_errors_match_their_covariance(lens: str) -> None:
    shift, focal = LENSES[lens]
    pair = example_pair(shift=shift, focal_px=focal)
    found = np.array([scores(calibrate_projector(scene(pair, seed)), pair) for seed in range(50)])
    # 50 means of six and nine: deviations 0.08 and 0.07. The prior on what nothing tells lowers the second.
    assert 0.75 < found[:, 0].mean() < 1.25
    assert 0.7 < found[:, 1].mean() < 1.2


def test_what_the_corners_carry_counts_once() -> None:
    """As two measurements the shared error is counted twice: the focal length is less certain, and said to be."""
    pair = example_pair()
    seen = scene(pair, 2)
    apart = replace(seen, views=tuple(replace(v, carried=None) for v in seen.views))
    once, twice = calibrate_projector(seen), calibrate_projector(apart)
    assert once.cameras["projector"].sigma["fx"] < 0.9 * twice.cameras["projector"].sigma["fx"]
    assert once.cell is not None


def test_terms_that_nothing_tells_are_left_out_and_said() -> None:
    """Three small boards in a narrow picture: k3 would fit noise."""
    pair = example_pair(shift=0.0, focal_px=2500.0)
    points, rng = grid(5, 4, 0.02), np.random.default_rng(3)
    poses = board_poses(pair, points, 3, rng, distance=(0.7, 1.1))
    result = calibrate_projector(carried_views(pair, points, poses, rng, corner_px=0.2, decoded_px=0.1))
    projector = result.cameras["projector"]
    assert (projector.parameters["k3"], projector.sigma["k3"]) == (0.0, 0.0)
    check = next(c for c in result.checks if c.name == "weak-terms-projector")
    assert "do not tell" in check.message
    assert "k3" in check.message
    assert least_told(projector) is None


def test_what_is_fixed_is_held_at_nothing() -> None:
    result = calibrate_projector(scene(example_pair(), 0), fix=("k2", "k3", "tangential"))
    for camera in result.cameras.values():
        assert [camera.parameters[n] for n in ("k2", "k3", "p1", "p2")] == [0.0] * 4


def test_the_lens_shift_is_said() -> None:
    result = calibrate_projector(scene(example_pair(shift=0.6, focal_px=2000.0), 0))
    check = next(c for c in result.checks if c.name == "lens-shift")
    assert "outside the picture" in check.message


def test_one_board_is_refused() -> None:
    seen = scene(example_pair(), 0, views=4)
    one = replace(seen, views=tuple(v for v in seen.views if v.camera == "camera" or v.id == "00"))
    with pytest.raises(RefusedError, match="1 boards were decoded"):
        calibrate_projector(one)


def test_other_names_are_told() -> None:
    with pytest.raises(InputError, match="observations are of camera"):
        calibrate_projector(scene(example_pair(), 0, views=2).of_camera("camera"))
