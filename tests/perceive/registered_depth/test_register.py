"""Depth brought onto a colour picture: exact without noise, as far off as stated with it, and nothing seen through."""

from __future__ import annotations

import numpy as np
import pytest
from tests.perceive.boxes_on_a_table import Thing, cast, d435, exact_depth, looking_down

from calibrant.cameras import Camera
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.perceive.registered_depth.holes import fill_holes
from calibrant.perceive.registered_depth.noise import D435, DepthNoise
from calibrant.perceive.registered_depth.planes import find_plane, rays_of
from calibrant.perceive.registered_depth.register import DepthRig, landing, landing_jacobians, register_depth

SIZE = (160, 120)
T_CD = se3.make(so3.exp([0.004, -0.01, 0.02]), [0.015, 0.001, -0.002])
T_TABLE = looking_down(0.5, 15.0)
BLOCK = Thing(se3.make(np.eye(3), [0.01, 0.02, 0.04]), np.array([0.08, 0.08, 0.08]))


def _camera(f: float, **more: float) -> Camera:
    return Camera.create("brown", {"fx": f, "fy": f, "cx": 80.3, "cy": 60.8, **more}, image_size=SIZE)


def _rig(**more: object) -> DepthRig:
    return DepthRig(_camera(150.0, k1=-0.05), _camera(140.0, k1=0.02), T_CD, **more)  # type: ignore[arg-type]


def _pixels(camera: Camera) -> np.ndarray:
    u, v = np.meshgrid(np.arange(SIZE[0], dtype=float), np.arange(SIZE[1], dtype=float))
    return np.stack([u, v], -1).reshape(-1, 2)


def _depth(rig: DepthRig, things: list[Thing]) -> np.ndarray:
    T = se3.inverse(rig.T_colour_depth) @ T_TABLE
    return cast(rig.depth, T, things, _pixels(rig.depth))[1].reshape(SIZE[::-1])


def test_a_plane_lands_where_the_colour_camera_sees_it() -> None:
    rig = _rig()
    found = register_depth(_depth(rig, []), rig, noise=D435)
    truth = cast(rig.colour, T_TABLE, [], _pixels(rig.colour))[1].reshape(SIZE[::-1])
    inner = np.zeros(truth.shape, bool)
    inner[15:-15, 15:-15] = True
    assert found.known[inner].mean() > 0.98
    # The sample is up to 0.7 px beside the pixel; the table falls off by 0.27 mm in depth a pixel's 3.3 mm.
    slope = np.abs(np.gradient(truth)).max()
    assert np.nanmax(np.abs(found.z - truth)[inner]) < 1.5 * slope


def test_what_is_hidden_from_the_colour_camera_is_not_seen_through_the_block() -> None:
    rig = _rig()
    found = register_depth(_depth(rig, [BLOCK]), rig, noise=D435)
    truth = cast(rig.colour, T_TABLE, [BLOCK], _pixels(rig.colour))[1].reshape(SIZE[::-1])
    assert found.hidden > 20
    behind = np.isfinite(found.z) & (found.z > truth + 0.02)
    # Pixels on the very edge of the block may show either.
    assert behind.sum() < 0.1 * found.hidden


def test_aligned_depth_stays_where_it_is() -> None:
    rig = DepthRig.aligned(_camera(150.0))
    z = _depth(rig, [BLOCK])
    found = register_depth(z, rig, noise=D435)
    assert np.array_equal(found.z, z)
    _, covariance = found.landing(found.known)
    assert np.all(covariance == 0)


def test_landing_slopes_are_central_differences() -> None:
    rig = _rig()
    rays = rays_of(rig.depth).reshape(-1, 3)[[2000, 9000, 15000]]
    uv = _pixels(rig.depth)[[2000, 9000, 15000]]
    z = np.array([0.4, 0.5, 0.7])
    _, J = landing_jacobians(rig, rays, z)

    def land(dz: float, delta: np.ndarray) -> np.ndarray:
        off = rig.moved(delta)
        r = off.depth.unproject(uv)
        return off.colour.project(se3.apply(off.T_colour_depth, r / r[:, 2:] * (z + dz)[:, None]))

    k = J.shape[2] - 1
    h = 1e-6
    assert J[:, :, 0] == pytest.approx((land(h, np.zeros(k)) - land(-h, np.zeros(k))) / (2 * h), rel=1e-5, abs=1e-4)
    for i in range(k):
        d = np.zeros(k)
        d[i] = h
        numeric = (land(0, d) - land(0, -d)) / (2 * h)
        assert J[:, :, 1 + i] == pytest.approx(numeric, rel=1e-4, abs=1e-4), i


@pytest.mark.statistics
def test_depths_land_as_far_off_as_stated() -> None:
    rng = np.random.default_rng(3)
    lens = np.diag([0.4, 0.4, 0.5, 0.5, 4e-3, 1e-9, 1e-9, 1e-9, 1e-9]) ** 2
    colour, depth = (
        Camera(c.model, c.image_size, c.values, lens[: len(c.values), : len(c.values)])
        for c in (_rig().colour, _rig().depth)
    )
    rig = DepthRig(colour, depth, T_CD, np.diag([1e-3] * 3 + [5e-4] * 3) ** 2)
    noise = DepthNoise(D435.inverse_sigma * 20, scale_sigma=0.01)
    flat = np.array([4000])
    z0 = 0.5
    depth_picture = np.full(SIZE[::-1], z0)
    uv, covariance = landing(rig, depth_picture, flat, noise=noise)
    root = np.linalg.cholesky(rig.calibration + 1e-24 * np.eye(len(rig.calibration)))
    squares = []
    for _ in range(400):
        truth = rig.moved(root @ rng.normal(size=len(root)))
        z = z0 + float(np.hypot(noise.sigma_z(z0), 0.01 * z0)) * rng.normal()
        ray = truth.depth.unproject(_pixels(rig.depth)[flat])
        true_uv = truth.colour.project(se3.apply(truth.T_colour_depth, ray / ray[:, 2:] * z))
        d = (uv - true_uv)[0]
        squares.append(d @ np.linalg.solve(covariance[0], d))
    # 400 draws of chi-square with 2 degrees of freedom: their mean is 2 with sigma 0.1.
    assert np.mean(squares) == pytest.approx(2.0, abs=0.35)


def test_depth_of_another_size_or_unit_is_named() -> None:
    rig = _rig()
    with pytest.raises(InputError, match="64 x 48"):
        register_depth(np.ones((48, 64)), rig, noise=D435)
    with pytest.raises(InputError, match="millimetres"):
        register_depth(np.full(SIZE[::-1], 540.0), rig, noise=D435)
    with pytest.raises(RefusedError, match="empty"):
        register_depth(np.zeros(SIZE[::-1]), rig, noise=D435)


def test_small_holes_in_planes_are_filled_and_told_others_stay() -> None:
    rig = DepthRig.aligned(_camera(150.0))
    z = _depth(rig, [])
    holey = z.copy()
    holey[40:46, 50:57] = np.nan  # small
    holey[80:110, 90:130] = np.nan  # too large
    holey[0:4, 0:4] = np.nan  # at the picture's edge
    out, filled = fill_holes(holey, noise=D435)
    assert filled.sum() == 42
    assert out[40:46, 50:57] == pytest.approx(z[40:46, 50:57], abs=1e-5)
    assert np.isnan(out[90, 100])
    assert np.isnan(out[0, 0])


def test_a_hole_across_a_step_is_not_filled() -> None:
    z = np.full((40, 40), 0.5)
    z[:, 20:] = 0.6
    z[15:20, 17:23] = np.nan
    out, filled = fill_holes(z, noise=D435)
    assert not filled.any()
    assert np.isnan(out[17, 20])


def test_the_table_is_found_below_clutter() -> None:
    camera = Camera.create("pinhole", {"fx": 300.0, "fy": 300.0, "cx": 159.5, "cy": 119.5}, image_size=(320, 240))
    clutter = [Thing(se3.make(np.eye(3), [x, 0.0, 0.03]), np.array([0.05, 0.2, 0.06])) for x in (-0.15, 0.0, 0.15)]
    z = d435(exact_depth(camera, T_TABLE, clutter), np.random.default_rng(0), f_b=15.0)
    noise = DepthNoise.stereo(focal_px=300, baseline_m=0.05)
    plane = find_plane(z, rays_of(camera), np.ones(z.shape, bool), noise=noise)
    truth = T_TABLE[:3, 2]
    assert np.rad2deg(np.arccos(min(1.0, plane.normal @ truth))) < 0.1
    assert plane.distance == pytest.approx(0.5 * np.cos(np.deg2rad(15)), abs=3e-4)
    assert plane.noise.inverse_sigma == pytest.approx(noise.inverse_sigma, rel=0.15)
    # Noise blurred by 1 px is shared by 4 pi pixels.
    assert plane.noise.pixels_per_sample == pytest.approx(4 * np.pi, rel=0.25)


def test_no_plane_is_said() -> None:
    rng = np.random.default_rng(0)
    camera = _camera(150.0)
    with pytest.raises(RefusedError, match="no plane"):
        find_plane(rng.uniform(0.3, 0.9, SIZE[::-1]), rays_of(camera), np.ones(SIZE[::-1], bool), noise=D435)


def test_a_plane_in_another_frame_is_the_same_plane() -> None:
    camera = _camera(150.0)
    plane = find_plane(_depth(DepthRig.aligned(camera), []), rays_of(camera), np.ones(SIZE[::-1], bool), noise=D435)
    p = np.array([[0.1, 0.0, 0.4], [0.0, -0.1, 0.6], [0.0, 0.0, 0.5]])
    assert plane.moved(T_CD).height(se3.apply(T_CD, p)) == pytest.approx(plane.height(p), abs=1e-12)
