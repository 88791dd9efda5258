"""Boards in colour and depth: sigma along the axis shrinks and stays true; the depth's scale is found with sigma."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from tests.perceive.boxes_on_a_table import d435

from calibrant.cameras import Camera
from calibrant.data import View
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.perceive.board_depth.board import CornersPose, board_pose, depth_scale
from calibrant.perceive.registered_depth.noise import DepthNoise
from calibrant.perceive.registered_depth.register import DepthRig
from calibrant.targets.registry import parse_target

SIGMA_PX = 0.2
POINTS = np.asarray(parse_target("chessboard:7x5:20mm").points, dtype=np.float64)
COLOUR = Camera.create("pinhole", {"fx": 308.0, "fy": 308.0, "cx": 160.0, "cy": 121.0}, image_size=(320, 240))
DEPTH = Camera.create("pinhole", {"fx": 260.0, "fy": 260.0, "cx": 158.0, "cy": 119.0}, image_size=(320, 240))
RIG = DepthRig(COLOUR, DEPTH, se3.make(so3.exp([0.01, -0.005, 0.02]), [0.015, 0.0, 0.001]))
NOISE = DepthNoise.stereo(focal_px=260.0, baseline_m=0.05, offset_px=0.0)


def _seen(
    rng: np.random.Generator, *, scale: float = 0.0, distance: float = 0.45
) -> tuple[np.ndarray, View, np.ndarray]:
    """A pose, the corners and the depth of a board at it."""
    R = so3.exp(rng.uniform(-0.4, 0.4, 3) * [1, 1, 2])
    T = se3.make(R, np.array([*rng.uniform(-0.03, 0.03, 2), distance]) - R @ POINTS.mean(axis=0))
    uv = COLOUR.project(se3.apply(T, POINTS)) + rng.normal(0, SIGMA_PX, (len(POINTS), 2))
    view = View(id="0", point_ids=np.arange(len(POINTS)), points=POINTS, uv=uv)
    Td = se3.inverse(RIG.T_colour_depth) @ T
    u, v = np.meshgrid(np.arange(320.0), np.arange(240.0))
    rays = DEPTH.unproject(np.stack([u, v], -1))
    rays = rays / rays[..., 2:]
    n = Td[:3, 2]
    z = (n @ Td[:3, 3]) / (rays @ n)
    return T, view, d435((1 + scale) * z, rng, f_b=13.0)


def test_depth_shrinks_the_sigma_along_the_axis() -> None:
    T, view, depth = _seen(np.random.default_rng(0))
    found = board_pose(view, depth, RIG, sigma_px=SIGMA_PX, noise=NOISE)
    assert found.gain > 3
    e = se3.local(T, found.T_camera_target)
    assert e @ np.linalg.solve(found.covariance, e) < chi2.ppf(0.999, 6)
    assert found.scale == 0.0


@pytest.mark.statistics
def test_poses_of_both_are_as_far_off_as_stated() -> None:
    squares, along = [], []
    for seed in range(80):
        T, view, depth = _seen(np.random.default_rng(seed))
        found = board_pose(view, depth, RIG, sigma_px=SIGMA_PX, noise=NOISE)
        e = se3.local(T, found.T_camera_target)
        squares.append(e @ np.linalg.solve(found.covariance, e))
        along.append(e[5] / np.sqrt(found.covariance[5, 5]))
    assert np.mean(squares) / 6 == pytest.approx(1.0, abs=0.2)
    assert np.sum(np.array(squares) < chi2.ppf(0.95, 6)) >= 70
    assert np.sqrt(np.mean(np.square(along))) == pytest.approx(1.0, abs=0.25)


@pytest.mark.statistics
def test_the_scale_of_the_depth_is_found_with_its_sigma() -> None:
    off = []
    for seed in range(40):
        rng = np.random.default_rng(1000 + seed)
        seen = [_seen(rng, scale=0.012, distance=d) for d in (0.35, 0.45, 0.5)]
        found = depth_scale([s[1] for s in seen], [s[2] for s in seen], RIG, sigma_px=SIGMA_PX, noise=NOISE)
        off.append((found.scale - 0.012) / found.sigma)
        assert found.sigma < 0.002
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(1.0, abs=0.3)


def test_a_scale_of_the_depth_stands_out() -> None:
    rng = np.random.default_rng(7)
    seen = [_seen(rng, scale=0.03) for _ in range(2)]
    found = depth_scale([s[1] for s in seen], [s[2] for s in seen], RIG, sigma_px=SIGMA_PX, noise=NOISE)
    assert found.scale > 5 * found.sigma
    assert len(found.views) == 2


def test_an_offset_is_told_from_a_factor_by_boards_at_several_distances() -> None:
    rng = np.random.default_rng(9)
    seen = [_seen(rng, distance=d) for d in (0.3, 0.4, 0.5, 0.6)]
    depths = [s[2] + 0.01 for s in seen]
    found = depth_scale([s[1] for s in seen], depths, RIG, sigma_px=SIGMA_PX, noise=NOISE)
    assert found.offset is not None
    assert found.offset_sigma is not None
    assert found.offset == pytest.approx(0.01, abs=4 * found.offset_sigma)
    assert found.offset > 3 * found.offset_sigma
    near = depth_scale([s[1] for s in seen[:1]], depths[:1], RIG, sigma_px=SIGMA_PX, noise=NOISE)
    assert near.offset is None


def test_the_lens_that_all_views_share_is_not_averaged() -> None:
    rng = np.random.default_rng(8)
    seen = [_seen(rng) for _ in range(4)]
    loose = Camera(COLOUR.model, COLOUR.image_size, COLOUR.values, np.diag([3.0, 3.0, 0.01, 0.01]) ** 2)
    rig = DepthRig(loose, DEPTH, RIG.T_colour_depth)
    found = depth_scale([s[1] for s in seen], [s[2] for s in seen], rig, sigma_px=SIGMA_PX, noise=NOISE)
    # 3 px of 308 in both focal lengths together, or 1 % in each alone: 0.7 % of distance and more.
    assert found.sigma > 0.005


def test_too_few_depths_and_other_targets_are_refused() -> None:
    _, view, depth = _seen(np.random.default_rng(0))
    with pytest.raises(RefusedError, match="have depth"):
        board_pose(view, np.where(np.arange(320) < 20, depth, np.nan), RIG, sigma_px=SIGMA_PX, noise=NOISE)
    bent = replace(view, id="b", points=POINTS + [[0, 0, 1e-3]] * (np.arange(len(POINTS)) % 2)[:, None])
    with pytest.raises(InputError, match="flat boards"):
        board_pose(bent, depth, RIG, sigma_px=SIGMA_PX, noise=NOISE)
    with pytest.raises(InputError, match="one for each"):
        depth_scale([view], [], RIG, sigma_px=SIGMA_PX, noise=NOISE)


def test_slopes_of_the_corners_are_central_differences() -> None:
    T, _, _ = _seen(np.random.default_rng(1))
    factor = CornersPose(T, np.diag([1.0, 2.0, 3.0, 1.0, 2.0, 3.0]) * 1e-4)
    at = se3.retract(T, [0.2, -0.1, 0.3, 0.01, 0.02, -0.01])[None]
    _, (J,) = factor.linearize(at)
    for k in range(6):
        d = 1e-6 * np.eye(6)[k]
        numeric = (factor.residuals(se3.retract(at, d)) - factor.residuals(se3.retract(at, -d))) / 2e-6
        assert J[:, :, k] == pytest.approx(numeric, rel=1e-5, abs=1e-5)
