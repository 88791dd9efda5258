"""Points in space from two direct linear transforms (slides 36 and 37)."""

from __future__ import annotations

import numpy as np
import pytest
from tests.calibrate.classical.classical_views import SOLID, camera, pose, seen

from calibrant.calibrate.classical import Degenerate, dlt, stereo_points
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.geometry.triangulation import triangulate

LENS_A, LENS_B = camera(fx=900.0), camera(fx=1500.0)
T_A = pose(20)
T_B = se3.make(T_A[:3, :3], T_A[:3, 3] + [0.1, 0.02, 0.1])
UNKNOWN = np.random.default_rng(21).uniform(-0.1, 0.1, (30, 3))


def cameras(noise: float = 0.0) -> np.ndarray:
    return np.stack(
        [dlt(SOLID, seen(c, T, SOLID, noise=noise, seed=i)) for i, (c, T) in enumerate([(LENS_A, T_A), (LENS_B, T_B)])]
    )


def pixels(noise: float = 0.0) -> np.ndarray:
    return np.stack([seen(LENS_A, T_A, UNKNOWN, noise=noise, seed=5), seen(LENS_B, T_B, UNKNOWN, noise=noise, seed=6)])


def test_two_calibrated_cameras_measure_points_to_1e9() -> None:
    np.testing.assert_allclose(stereo_points(cameras(), pixels()), UNKNOWN, atol=1e-9)


def test_a_third_camera_may_miss_some_points() -> None:
    P = np.concatenate([cameras(), dlt(SOLID, seen(LENS_A, pose(22), SOLID))[None]])
    uv = np.concatenate([pixels(), seen(LENS_A, pose(22), UNKNOWN)[None]])
    uv[2, ::2] = np.nan
    uv[0, 1] = np.nan
    np.testing.assert_allclose(stereo_points(P, uv), UNKNOWN, atol=1e-9)


def test_noisy_points_are_as_good_as_those_of_rays() -> None:
    uv = pixels(0.3)
    rays = np.stack([LENS_A.unproject(uv[0]), LENS_B.unproject(uv[1])])
    by_rays = triangulate(rays, T_world_camera=se3.inverse(np.stack([T_A, T_B])))
    error, reference = (np.sqrt(np.mean((p - UNKNOWN) ** 2)) for p in (stereo_points(cameras(), uv), by_rays))
    # Two linear criteria weigh the same rays a little differently; neither is the maximum-likelihood one.
    assert error < 1.3 * reference
    # 0.3 px at f = 900 px and 0.6 m is 0.2 mm across, and about 6 times that in depth with a baseline of 0.1 m.
    assert error < 2e-3


def test_cameras_in_one_place_are_refused() -> None:
    P, uv = cameras(), pixels()
    with pytest.raises(Degenerate, match=r"parallel rays: .*point 0 along one line.*move them apart"):
        stereo_points(P[[0, 0]], uv[[0, 0]])


def test_unusable_input_is_named() -> None:
    P, uv = cameras(), pixels()
    with pytest.raises(InputError, match=r"P \(views, 3, 4\)"):
        stereo_points(P[0], uv)
    uv[0, 4] = np.nan
    with pytest.raises(InputError, match=r"point 4 is seen by 1 cameras"):
        stereo_points(P, uv)
