"""Fast calibration from the target's axes (slides 65 to 67)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.calibrate.classical.classical_views import (
    ASPECT,
    BOARD,
    CENTRE,
    SIZE,
    SOLID,
    camera,
    deviation,
    pose,
    seen,
)

from calibrant.calibrate.classical import Degenerate, calibrate_fast_rac, calibrate_tsai_coplanar
from calibrant.geometry import se3, so3

KNOWN = {"image_size": SIZE, "centre": CENTRE, "aspect": ASPECT}
ON_AXES = (np.abs(BOARD[:, :2]) < 1e-12).any(axis=1)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), radial=st.sampled_from(["pinhole", "division"]), tilt=st.floats(0.1, 0.9))
def test_exact_points_give_the_truth_to_1e9(seed: int, radial: str, tilt: float) -> None:
    truth, T = camera(radial), pose(seed, tilt=tilt)
    found = calibrate_fast_rac(BOARD, seen(truth, T, BOARD), **KNOWN)
    assert deviation(found.camera, truth, found.T_camera_target[0], T) < 1e-9


def test_the_axes_alone_are_enough() -> None:
    truth, T = camera("division"), pose(50)
    found = calibrate_fast_rac(BOARD[ON_AXES], seen(truth, T, BOARD[ON_AXES]), **KNOWN)
    assert deviation(found.camera, truth, found.T_camera_target[0], T) < 1e-9


def test_the_axes_may_start_at_a_corner() -> None:
    corner = BOARD - BOARD[0]
    truth, T = camera("division"), pose(51) @ se3.make(np.eye(3), BOARD[0])
    found = calibrate_fast_rac(corner, seen(truth, T, corner), **KNOWN)
    assert deviation(found.camera, truth, found.T_camera_target[0], T) < 1e-9


@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_the_failures_are_refused_by_name(noise: float) -> None:
    truth = camera()
    facing = seen(truth, pose(52, tilt=0.0), BOARD, noise=noise)
    with pytest.raises(Degenerate, match=r"fronto-parallel"):
        calibrate_fast_rac(BOARD, facing, **KNOWN)
    T = pose(53)
    T[1, 3] = 0
    with pytest.raises(Degenerate, match=r"t_y = 0: .*principal point's row"):
        calibrate_fast_rac(BOARD, seen(truth, T, BOARD, noise=noise), **KNOWN)


def test_what_the_method_cannot_use_is_refused() -> None:
    truth, T = camera(), pose(54)
    uv = seen(truth, T, BOARD)
    with pytest.raises(Degenerate, match=r"no points on the axes: .*origin is not seen"):
        calibrate_fast_rac(BOARD[:18], uv[:18], **KNOWN)
    few = ON_AXES & ((BOARD[:, 0] == 0) | (np.abs(BOARD[:, 0] - 0.03) < 1e-9))
    with pytest.raises(Degenerate, match=r"no points on the axes: .*seen, with 1 points on its x axis and 6"):
        calibrate_fast_rac(BOARD[few], uv[few], **KNOWN)
    with pytest.raises(Degenerate, match=r"points with depth"):
        calibrate_fast_rac(SOLID, seen(truth, T, SOLID), **KNOWN)
    with pytest.raises(Degenerate, match=r"too few points"):
        calibrate_fast_rac(BOARD[[0, 4, 10, 20]], uv[[0, 4, 10, 20]], **KNOWN)


def test_an_axis_through_the_principal_point_is_refused() -> None:
    """The x axis then looks like a radius, along which the constraint says nothing."""
    R = so3.exp([0, 0, 0.8]) @ so3.exp([0.5, 0, 0])
    T = se3.make(R, 0.05 * R[:, 0] * [1, 1, 0] + [0, 0, 0.6])
    with pytest.raises(Degenerate, match=r"undetermined: an axis of the target points at the principal point"):
        calibrate_fast_rac(BOARD, seen(camera(), T, BOARD), **KNOWN)


@pytest.mark.statistics
def test_the_origins_noise_makes_it_worse_than_all_points_together() -> None:
    truth, T = camera("division"), pose(55)
    errors = []
    for seed in range(40):
        uv = seen(truth, T, BOARD, noise=0.02, seed=seed)
        both = (calibrate_fast_rac(BOARD, uv, **KNOWN), calibrate_tsai_coplanar(BOARD, uv, **KNOWN))
        errors.append([f.camera.parameters["fx"] / 900 - 1 for f in both])
    fast, tsai = np.std(errors, axis=0)
    assert 2 * tsai < fast < 0.2
