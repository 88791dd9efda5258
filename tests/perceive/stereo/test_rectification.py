"""Rectified pairs: matches share a row, depth is f B / d, alpha means what it says, wide lenses too."""

from __future__ import annotations

import numpy as np
import pytest
from tests.perceive.stereo.made import LEFT, RIGHT, T_LEFT_RIGHT, made_eyes, pixels_of, seen_points

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.opencv import cv2
from calibrant.perceive.stereo.eyes import Eyes
from calibrant.perceive.stereo.rectification import PRINCIPALS, PROJECTIONS, Principal, Projection, rectification

FISHEYE = Camera.create(
    "kannala_brandt", {"fx": 200.0, "fy": 200.0, "cx": 320.0, "cy": 240.0, "k1": 0.01}, image_size=(640, 480)
)


def _fisheyes(T: Array) -> Eyes:
    size = 6 + 2 * len(FISHEYE.values)
    return Eyes(("left", "right"), (FISHEYE, FISHEYE), np.stack([np.eye(4), T]), np.zeros((size, size)))


VERTICAL = se3.make(so3.exp([0.04, 0.01, 0.02]), [0.003, 0.09, -0.005])


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("principal", PRINCIPALS)
@pytest.mark.parametrize("T", [T_LEFT_RIGHT, VERTICAL], ids=["beside", "above"])
def test_matches_share_a_row_and_tell_the_depth(projection: Projection, principal: Principal, T: Array) -> None:
    eyes = made_eyes(T=T)
    X = seen_points(eyes, 50, np.random.default_rng(1))
    uv = pixels_of(eyes, X)
    pair = rectification(eyes, projection=projection, principal=principal, alpha=0.3)
    assert pair.along == (0 if T is T_LEFT_RIGHT else 1)
    assert np.abs(pair.row_errors(uv)).max() < 1e-6
    assert pair.baseline == pytest.approx(np.linalg.norm(T[:3, 3]))
    left, right = (pair.pixels(i, uv[i]) for i in (0, 1))
    a, b = pair.views
    shift = (a.cx - b.cx, a.cy - b.cy)
    d = (left - right)[:, pair.along] - shift[pair.along]
    p = X @ pair.R_rectified_camera[0].T
    np.testing.assert_allclose(a.f * pair.baseline / d, a.depth(p), rtol=1e-9)
    if principal == "equal":
        assert shift == (0.0, 0.0)
    if projection == "pinhole":
        d = (left - right)[:, pair.along]
        rows = np.concatenate([left, d[:, None], np.ones((50, 1))], axis=1) @ pair.Q.T
        np.testing.assert_allclose(rows[:, :3] / rows[:, 3:], p, rtol=1e-9)
        rectified = [
            c.project(se3.apply(t, p)) for c, t in zip(pair.cameras, (np.eye(4), se3.inverse(pair.T_left_right)))
        ]
        np.testing.assert_allclose(rectified, [left, right], atol=1e-6)
    for i in (0, 1):
        np.testing.assert_allclose(pair.own_pixels(i, (left, right)[i]), uv[i], atol=1e-6)


def test_the_turns_are_opencvs() -> None:
    eyes = made_eyes()
    pair = rectification(eyes)
    T = se3.inverse(T_LEFT_RIGHT)
    ours = [np.array([c.parameters[k] for k in ("k1", "k2", "p1", "p2", "k3")]) for c in (LEFT, RIGHT)]
    R1, R2, *_ = cv2.stereoRectify(LEFT.K, ours[0], RIGHT.K, ours[1], (640, 480), T[:3, :3], T[:3, 3:])
    np.testing.assert_allclose(pair.R_rectified_camera, [R1, R2], atol=1e-9)


def test_alpha_goes_from_no_pixel_without_source_to_every_source_pixel() -> None:
    eyes = made_eyes()
    whole = rectification(eyes, alpha=0.0)
    assert all(m.valid.mean() > 0.999 for m in whole.maps)  # the border is looked at in nine points a side
    shown = rectification(eyes, alpha=1.0)
    for i, camera in enumerate(eyes.cameras):
        width, height = camera.image_size
        edge = np.array([[u, v] for u in (0, width / 2, width - 1) for v in (0, height / 2, height - 1)])
        seen = shown.pixels(i, edge)
        assert np.all(seen > -1)
        assert np.all(seen < [width, height])
    assert shown.views[0].f < whole.views[0].f
    large = rectification(eyes, image_size=(1280, 960))
    assert large.maps[0].map_u.shape == (960, 1280)
    assert large.views[0].f == pytest.approx(2 * whole.views[0].f, rel=0.01)
    assert rectification(eyes, focal_px=300.0).views[0].f == 300.0


def test_fisheyes_become_pinholes_or_cylinders() -> None:
    """A cylinder about the baseline shows directions that no pinhole has."""
    eyes = _fisheyes(se3.make(so3.exp([0.02, 0.03, -0.01]), [0.1, 0.0, 0.0]))
    pair = rectification(eyes, projection="cylinder", alpha=1.0)
    steep = np.array([[0.05, np.sin(a), np.cos(a)] for a in np.deg2rad([-65.0, 0.0, 65.0])]) * 0.7
    uv = pixels_of(eyes, steep)
    assert np.abs(pair.row_errors(uv)).max() < 1e-6
    seen = pair.pixels(0, uv[0])
    assert np.all((seen > 0) & (seen < [640, 480]))
    flat = rectification(eyes, alpha=0.0)
    assert all(m.valid.mean() > 0.98 for m in flat.maps)
    with pytest.raises(InputError, match="no Q"):
        _ = pair.Q


def test_sides_that_are_exchanged_have_a_negative_baseline() -> None:
    assert rectification(made_eyes(T=se3.inverse(T_LEFT_RIGHT))).baseline < 0


def test_bad_input_is_named() -> None:
    eyes = made_eyes()
    with pytest.raises(InputError, match="alpha is 2"):
        rectification(eyes, alpha=2.0)
    with pytest.raises(InputError, match="behind"):
        rectification(made_eyes(T=se3.make(np.eye(3), [0.01, 0.0, 0.2])))
    with pytest.raises(InputError, match="where left is"):
        rectification(made_eyes(T=np.eye(4)))
    with pytest.raises(InputError, match="look past each other; try --principal own"):
        rectification(made_eyes(T=se3.make(so3.exp([0.0, 1.4, 0.0]), [0.1, 0.0, 0.0])))
    with pytest.raises(InputError, match="pinhole, cylinder"):
        rectification(eyes, projection="sphere")  # type: ignore[arg-type]
