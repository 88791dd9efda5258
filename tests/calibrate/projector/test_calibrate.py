"""Projectors: exact on exact data whatever the lens shift, honest on noisy data, clear about what nothing tells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.calibrate.cell.lit.checks import untold
from calibrant.calibrate.projector.calibrate import calibrate_projector
from calibrant.calibrate.reprojection.weak_terms import corner_reach, term_sigma
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Observations
from calibrant.errors import InputError, RefusedError
from calibrant.simulate.projector.points import ProjectorPair, board_poses, carried_views, example_pair
from calibrant.simulate.scenes import grid
from calibrant.simulate.truth import chi_square, normalised

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
    """Squared error over the covariance of pose and projector, a degree of freedom; every term has its sigma."""
    projector = result.cameras["projector"]
    error = projector.values - pair.projector.values
    assert projector.covariance is not None
    lens = chi_square(error, projector.covariance) / len(error)
    return normalised(result.transform("camera", "projector"), pair.T_camera_projector) / 6, lens


def lens_of_the_prior(projector: Camera, seed: int) -> Camera:
    """The projector with a distortion drawn from what lenses do."""
    rng, reach = np.random.default_rng(seed), corner_reach(projector)
    drawn = {n: s * rng.normal() for n in projector.parameters if (s := term_sigma(n, reach)) is not None}
    return Camera.create("brown", projector.parameters | drawn, image_size=projector.image_size)


@pytest.mark.statistics
@pytest.mark.parametrize("lens", LENSES)
def test_errors_match_their_covariance(lens: str) -> None:
    shift, focal = LENSES[lens]
    pair = example_pair(shift=shift, focal_px=focal)
    found = np.array([scores(calibrate_projector(scene(pair, seed)), pair) for seed in range(50)])
    # 50 means of six and nine: deviations 0.08 and 0.07. The prior on what nothing tells lowers the second.
    assert 0.75 < found[:, 0].mean() < 1.25
    assert 0.7 < found[:, 1].mean() < 1.2


@pytest.mark.statistics
@pytest.mark.parametrize(("lens", "seeds"), [("short", 20), ("middle", 20)])
def test_a_weak_terms_sigma_holds_what_lenses_do(lens: str, seeds: int) -> None:
    """Six boards hardly tell k3. Whatever it truly is, as far as lenses go, sigma of all terms holds it."""
    shift, focal = LENSES[lens]
    found, weak = [], 0
    for seed in range(seeds):
        pair = example_pair(shift=shift, focal_px=focal)
        pair = replace(pair, projector=lens_of_the_prior(pair.projector, seed))
        result = calibrate_projector(scene(pair, seed, views=6, corner_px=0.2, decoded_px=0.1))
        weak += "k3" in untold(result.cameras["projector"])
        found.append(scores(result, pair))
    assert weak >= seeds / 4
    # 20 means of nine: a deviation of 0.11.
    assert 0.6 < np.mean(found, axis=0)[1] < 1.35


def test_what_lenses_do_is_said_of_the_lens_that_was_found() -> None:
    """A strong distortion takes the start, which knows none, far off: the prior is the fit's own, not the start's."""
    pair = example_pair(shift=0.0, focal_px=2500.0)
    strong = pair.projector.parameters | {"k1": -1.0, "k2": -1.2, "p1": 0.009, "p2": -0.021, "k3": 59.0}
    pair = replace(pair, projector=Camera.create("brown", strong, image_size=pair.projector.image_size))
    result = calibrate_projector(scene(pair, 4, views=6, corner_px=0.2, decoded_px=0.1))
    projector = result.cameras["projector"]
    assert abs(projector.parameters["k3"] - 59.0) < 4 * projector.sigma["k3"]
    assert projector.sigma["k3"] > 10


def test_what_the_corners_carry_counts_once() -> None:
    """As two measurements the shared error is counted twice: the focal length is less certain, and said to be."""
    pair = example_pair()
    seen = scene(pair, 2)
    apart = replace(seen, views=tuple(replace(v, carried=None) for v in seen.views))
    once, twice = calibrate_projector(seen), calibrate_projector(apart)
    assert once.cameras["projector"].sigma["fx"] < 0.9 * twice.cameras["projector"].sigma["fx"]
    assert once.cell is not None


def test_terms_that_nothing_tells_are_held_and_said() -> None:
    """Three small boards in a narrow picture: k3 would fit noise."""
    pair = example_pair(shift=0.0, focal_px=2500.0)
    points, rng = grid(5, 4, 0.02), np.random.default_rng(3)
    poses = board_poses(pair, points, 3, rng, distance=(0.7, 1.1))
    result = calibrate_projector(carried_views(pair, points, poses, rng, corner_px=0.2, decoded_px=0.1))
    projector = result.cameras["projector"]
    prior = term_sigma("k3", corner_reach(projector))
    assert prior is not None
    assert 0.5 * prior < projector.sigma["k3"] <= 1.05 * prior
    assert abs(projector.parameters["k3"]) < 2 * prior
    check = next(c for c in result.checks if c.name == "weak-terms-projector")
    assert "hardly tell" in check.message
    assert "held near 0" in check.message
    assert "k3" in check.message


@pytest.mark.long
def test_what_is_fixed_is_held_at_nothing() -> None:
    result = calibrate_projector(scene(example_pair(), 0), fix=("k2", "k3", "tangential"))
    for camera in result.cameras.values():
        assert [camera.parameters[n] for n in ("k2", "k3", "p1", "p2")] == [0.0] * 4


@pytest.mark.long
def test_the_lens_shift_is_said() -> None:
    result = calibrate_projector(scene(example_pair(shift=0.6, focal_px=2000.0), 0))
    check = next(c for c in result.checks if c.name == "lens-shift")
    assert "outside the picture" in check.message


def bent(bend_m: float, *, views: int) -> Observations:
    """Views of a board that is bent along its length and said to be flat."""
    pair, rng = example_pair(), np.random.default_rng(2)
    poses = board_poses(pair, POINTS, views, rng, distance=(0.7, 1.1))
    along = 2 * (POINTS[:, 0] - POINTS[:, 0].min()) / np.ptp(POINTS[:, 0]) - 1
    real = POINTS + np.outer(bend_m * (1 - along**2), [0.0, 0.0, 1.0])
    seen = carried_views(pair, real, poses, rng, corner_px=0.05, decoded_px=0.03)
    return replace(seen, views=tuple(replace(v, points=POINTS) for v in seen.views))


@pytest.mark.long
@pytest.mark.parametrize("views", [5, 8])
def test_a_bent_board_is_named_first_with_its_size(views: int) -> None:
    """Too few captures to ask the photos of the camera alone: the pictures of both eyes tell."""
    first = calibrate_projector(bent(0.004, views=views)).checks[0]
    assert (first.name, first.status) == ("board-flatness", "warn")
    assert first.message.startswith("the board is bent: all pictures of camera and projector fit best with ")
    assert first.value == pytest.approx(4.0, rel=0.2)  # lenses and poses went far with it: a step is not all of it
    flat = calibrate_projector(bent(0.0, views=views)).checks[0]
    assert (flat.name, flat.status) == ("board-flatness", "ok")
    assert flat.value < 0.1


@pytest.mark.long
def test_a_lens_that_errs_alike_in_all_captures_bends_no_board() -> None:
    """Triangulated corners are bent alike where all boards were at one place: the pictures fit no better for it."""
    pair, rng = example_pair(), np.random.default_rng(5)
    poses = board_poses(pair, POINTS, 6, rng, distance=(0.85, 0.95))
    seen = carried_views(pair, POINTS, poses, rng, corner_px=0.05, decoded_px=0.03)
    wrong = [calibrate_projector(seen, fix=fix).checks[0] for fix in ((), ("k3",), ("k2", "k3", "tangential"))]
    assert [(c.name, c.status) for c in wrong] == [("board-flatness", "ok")] * 3


def test_one_board_is_refused() -> None:
    seen = scene(example_pair(), 0, views=4)
    one = replace(seen, views=tuple(v for v in seen.views if v.camera == "camera" or v.id == "00"))
    with pytest.raises(RefusedError, match="1 boards were decoded"):
        calibrate_projector(one)


def test_other_names_are_told() -> None:
    with pytest.raises(InputError, match="observations are of camera"):
        calibrate_projector(scene(example_pair(), 0, views=2).of_camera("camera"))
