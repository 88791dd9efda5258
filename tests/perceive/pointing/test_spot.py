"""Pointing: the spot is exact on exact points, as certain as stated on noisy ones, and refused where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.perceive.pointing.spot import (
    COLLINEAR,
    COMMON_PLANE,
    PARALLEL,
    UNIT_PLANE,
    Ambiguous,
    Sight,
    pointing_spot,
)

CHI2_2_AT_95 = 5.991
TABLE = np.array(UNIT_PLANE) * 0.8 - 0.4
MORE = np.concatenate([TABLE, [[0.0, 0.1], [-0.2, 0.3], [0.25, -0.15]]])
CAMERAS = [
    Camera.create("pinhole", {"fx": f, "fy": f, "cx": 322.0, "cy": 236.0}, image_size=(640, 480))
    for f in (620.0, 555.0)
]


def _looking(eye: Array) -> Array:
    """T_camera_plane of a camera at `eye` that looks at the plane's middle."""
    z = -eye / np.linalg.norm(eye)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    return se3.inverse(se3.make(np.stack([x, np.cross(z, x), z], axis=1), eye))


LEFT, RIGHT = _looking(np.array([-0.7, -0.6, 1.1])), _looking(np.array([0.8, -0.5, 1.0]))
SPOT = np.array([0.13, -0.07])
HAND = np.array([0.02, 0.2, 0.5])


def _sight(camera: Camera, T: Array, corners: Array, ends: Array) -> Sight:
    flat = np.concatenate([corners, np.zeros((len(corners), 1))], axis=1)
    return Sight(camera.project(se3.apply(T, flat)), camera.project(se3.apply(T, ends)))


def _pointer(spot: Array = SPOT, hand: Array = HAND) -> Array:
    """Two points of the axis, away from the plane."""
    foot = np.append(spot, 0.0)
    return np.stack([hand, foot + 0.4 * (hand - foot)])


def _both(corners: Array = TABLE, ends: Array | None = None) -> list[Sight]:
    return [_sight(c, T, corners, _pointer() if ends is None else ends) for c, T in zip(CAMERAS, (LEFT, RIGHT))]


@pytest.mark.parametrize("corners", [TABLE, MORE])
def test_exact_points_give_the_exact_spot(corners: Array) -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        spot = rng.uniform(-0.4, 0.4, 2)
        hand = np.append(rng.uniform(-0.3, 0.3, 2), rng.uniform(0.3, 0.6))
        found = pointing_spot(*_both(corners, _pointer(spot, hand)), plane=corners)
        np.testing.assert_allclose(found.xy, spot, atol=1e-9)
        seen = [c.project(se3.apply(T, np.append(spot, 0.0))) for c, T in zip(CAMERAS, (LEFT, RIGHT))]
        np.testing.assert_allclose(found.uv, seen, atol=1e-6)


def test_the_unit_square_is_the_plane_by_default() -> None:
    found = pointing_spot(*_both())
    np.testing.assert_allclose(found.xy, (SPOT + 0.4) / 0.8, atol=1e-9)


def test_the_covariance_is_the_propagated_one() -> None:
    """J of every pixel that is given, by central differences."""
    sights = _both(MORE)
    found = pointing_spot(*sights, plane=MORE, sigma_px=0.3)
    C = np.zeros((2, 2))
    for side in (0, 1):
        for part in ("corners", "axis"):
            for index in np.ndindex(getattr(sights[side], part).shape):
                ends = []
                for step in (1e-4, -1e-4):
                    moved = {"corners": sights[side].corners.copy(), "axis": sights[side].axis.copy()}
                    moved[part][index] += step
                    pair = list(sights)
                    pair[side] = Sight(**moved)
                    ends.append(pointing_spot(*pair, plane=MORE, sigma_px=0.3).xy)
                J = (ends[0] - ends[1]) / 2e-4
                C += 0.3**2 * np.outer(J, J)
    np.testing.assert_allclose(found.covariance, C, rtol=1e-5)


@pytest.mark.statistics
@pytest.mark.parametrize("corners", [TABLE, MORE])
def test_noisy_spots_lie_within_the_predicted_region_as_often_as_said(corners: Array) -> None:
    """500 trials: 95 % within 1 % of chance, so 93 to 97 % are two of its sigmas."""
    rng = np.random.default_rng(11)
    inside = trials = 0
    while trials < 500:
        spot = rng.uniform(-0.35, 0.35, 2)
        hand = np.append(rng.uniform(-0.3, 0.3, 2), rng.uniform(0.35, 0.6))
        sights = _both(corners, _pointer(spot, hand))
        if pointing_spot(*sights, plane=corners, sigma_px=1e-6).crossing_deg < 20:
            continue  # first order is not enough where the lines nearly coincide, and the check says so
        trials += 1
        noisy = [
            Sight(s.corners + rng.normal(0, 0.3, s.corners.shape), s.axis + rng.normal(0, 0.3, (2, 2))) for s in sights
        ]
        found = pointing_spot(*noisy, plane=corners, sigma_px=0.3)
        off = found.xy - spot
        inside += off @ np.linalg.solve(found.covariance, off) < CHI2_2_AT_95
    assert 465 <= inside <= 485


def test_corners_that_do_not_fit_the_noise_are_told_by_their_chance() -> None:
    sights = _both(MORE)
    assert pointing_spot(*sights, plane=MORE).fits == pytest.approx(1.0)
    bent = Sight(sights[0].corners + np.array([[0, 0]] * 5 + [[6.0, 0], [0, 0]]), sights[0].axis)
    found = pointing_spot(bent, sights[1], plane=MORE)
    assert found.fits is not None
    assert found.fits < 1e-6
    assert found.rms_px is not None
    assert found.rms_px > 0.5
    assert pointing_spot(*_both()).fits is None


def test_corners_on_a_line_are_refused_by_name() -> None:
    line = np.array([[0.0, 0.0], [0.1, 0.1], [0.2, 0.2], [0.3, 0.3]])
    three = np.array([[0.0, 0.0], [0.1, 0.1], [0.2, 0.2], [0.3, -0.1]])
    for corners in (line, three):
        with pytest.raises(Ambiguous, match="collinear corners") as refused:
            pointing_spot(*_both(corners), plane=corners)
        assert refused.value.name == COLLINEAR
    with pytest.raises(Ambiguous, match="all corners but number 4 lie on one line in the left picture"):
        pointing_spot(*_both(three), plane=TABLE)


def test_a_pointer_in_one_plane_with_both_cameras_is_refused_by_name() -> None:
    eyes = [se3.inverse(T)[:3, 3] for T in (LEFT, RIGHT)]
    middle = (eyes[0] + eyes[1]) / 2
    hand = 0.5 * middle + 0.5 * np.append(SPOT, 0.0)
    with pytest.raises(Ambiguous, match="may be the spot") as refused:
        pointing_spot(*_both(ends=_pointer(hand=hand)), plane=TABLE, sigma_px=0.2)
    assert refused.value.name == COMMON_PLANE
    with pytest.raises(Ambiguous) as refused:
        pointing_spot(*_both(ends=_pointer(hand=hand)), plane=TABLE, sigma_px=1e-12)
    assert refused.value.name == COMMON_PLANE


@pytest.mark.parametrize("sigma_px", [0.2, 1e-12])
def test_a_pointer_parallel_to_the_plane_is_refused_by_name(sigma_px: float) -> None:
    ends = np.array([[0.0, 0.0, 0.3], [0.2, 0.1, 0.3]])
    with pytest.raises(Ambiguous, match="parallel") as refused:
        pointing_spot(*_both(ends=ends), plane=TABLE, sigma_px=sigma_px)
    assert refused.value.name == PARALLEL


def test_bad_input_is_named() -> None:
    left, right = _both()
    with pytest.raises(InputError, match="the right camera sees"):
        pointing_spot(left, _both(MORE)[1], plane=TABLE)
    with pytest.raises(InputError, match="the same pixel"):
        Sight(left.corners, [[3.0, 4.0], [3.0, 4.0]])
    with pytest.raises(InputError, match="in this order"):
        pointing_spot(Sight(left.corners[[0, 3, 1, 2]], left.axis), right, plane=TABLE)
    with pytest.raises(InputError, match="clockwise"):
        pointing_spot(Sight([640, 0] - left.corners * [1, -1], left.axis), right, plane=TABLE)
    with pytest.raises(InputError, match="four corners"):
        Sight(left.corners[:3], left.axis)
    with pytest.raises(InputError, match="NaN"):
        Sight(left.corners * np.nan, left.axis)
    with pytest.raises(InputError, match="noise is 0"):
        pointing_spot(left, right, plane=TABLE, sigma_px=0.0)
