"""Cameras compared by what they see: the rotation found, what is left, its sigma, other models and sizes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.made_results import camera

from calibrant.cameras import Camera
from calibrant.cameras.approximation.nearest import in_words_of
from calibrant.diagnose.compare.cameras import compare_cameras, differences
from calibrant.errors import InputError
from calibrant.geometry import so3

PLAIN = {"fx": 800.0, "fy": 800.0, "cx": 319.5, "cy": 239.5}


def pinhole(**changed: float) -> Camera:
    return Camera.create("pinhole", {**PLAIN, **changed}, image_size=(640, 480))


def test_a_camera_is_like_itself() -> None:
    found = compare_cameras(camera(), camera())
    assert found.most_px < 1e-9
    assert found.rotated_most_px < 1e-9
    assert found.chance == pytest.approx(1.0)
    assert found.shared == 1.0
    assert all(p.difference == 0.0 for p in found.parameters)


def test_numbers_by_hand() -> None:
    """A principal point 1 px to the right is 1 px everywhere; a focal length twice as long doubles the distance."""
    moved = compare_cameras(pinhole(), pinhole(cx=320.5))
    assert moved.rms_px == pytest.approx(1.0, abs=1e-12)
    assert moved.most_px == pytest.approx(1.0, abs=1e-12)
    longer = differences(pinhole(), pinhole(fx=808.0, fy=808.0))
    assert np.allclose(longer.d, 0.01 * (longer.uv - [319.5, 239.5]), atol=1e-9)


def test_the_implied_rotation_is_the_one_that_was_put_in() -> None:
    """Pixels of a turned camera: the second's rays are the first's by R, so that nothing is left."""
    first, turn = camera(), np.array([2e-3, -1e-3, 3e-3])
    pictured = differences(first, first)
    rays = first.unproject(pictured.uv) @ so3.exp(turn).T
    from calibrant.diagnose.compare.cameras import _implied

    R = _implied(first, first.unproject(pictured.uv), first.project(rays), np.ones(2))
    assert np.allclose(so3.log(R), turn, atol=1e-10)


def test_the_same_lens_in_other_words_leaves_nothing_and_shares_parameters() -> None:
    first = camera()
    second = in_words_of(first, ("rational",))
    assert second is not None
    found = compare_cameras(first, second)
    assert found.rotated_most_px < 1e-9
    by_name = {p.name: p for p in found.parameters}
    assert by_name["fx"].difference == pytest.approx(0.0, abs=1e-9)
    assert by_name["fx"].sigma == pytest.approx(np.hypot(0.26, 0.26))
    other = compare_cameras(first, Camera.create("kannala_brandt", PLAIN | {"fx": 905.0}, image_size=first.image_size))
    assert all(p.difference is None for p in other.parameters)


def test_half_the_size_is_the_same_camera() -> None:
    """Pixel areas scale: cx + 1/2 halves."""
    terms = {"fx": 400.0, "fy": 400.0, "cx": 159.5, "cy": 119.5}
    half = Camera.create("pinhole", terms, image_size=(320, 240))
    assert compare_cameras(pinhole(), half).most_px < 1e-9
    assert compare_cameras(half, pinhole()).most_px < 1e-9


@pytest.mark.statistics
def test_sigmas_are_those_of_differences_drawn_from_both_covariances() -> None:
    """RMS of what is left and of the rotation as stated, and a chance below 0.1 about as often as it says."""
    rng, mean = np.random.default_rng(0), camera()
    C = mean.covariance
    assert C is not None
    draws = rng.multivariate_normal(mean.values, C, size=(300, 2))
    squares, turns, chances = [], [], []
    for a, b in draws:
        found = differences(replace(mean, values=a), replace(mean, values=b))
        squares.append(np.mean(np.sum(found.left**2, axis=1)))
        turns.append(found.rotation)
        chances.append(found.chance)
    stated = differences(mean, mean)
    assert np.sqrt(np.mean(squares)) == pytest.approx(stated.expected_px, rel=0.2)
    assert stated.rotation_sigma is not None
    assert np.std(turns, axis=0)[:2] == pytest.approx(stated.rotation_sigma[:2], rel=0.2)
    assert 0.02 < np.mean(np.array(chances) < 0.1) < 0.15


def test_a_difference_of_many_sigmas_has_no_chance() -> None:
    first = camera()
    far = replace(first, values=first.values + 20 * np.sqrt(np.diag(first.covariance)))  # type: ignore[arg-type]
    found = compare_cameras(first, far)
    assert found.chance is not None
    assert found.chance < 1e-6


def test_cameras_without_a_common_field_are_refused() -> None:
    flat = Camera.create("orthographic", {"fx": 100.0, "fy": 100.0, "cx": 10.0, "cy": 10.0}, image_size=(640, 480))
    with pytest.raises(InputError, match="parallel rays"):
        compare_cameras(pinhole(), flat)
