from __future__ import annotations

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.geometry.triangulation import refine_points, triangulate

VIEWS = 4


def cameras() -> np.ndarray:
    """T_world_camera (4, 4, 4): cameras on a line, all looking along z with small tilts; the last stands far back."""
    rng = np.random.default_rng(18)
    t = np.array([[0, 0, 0], [0.3, 0, 0], [0.6, 0.1, 0], [0.2, 0.5, -2.0]])
    return se3.make(so3.exp(0.1 * rng.normal(size=(VIEWS, 3))), t)


def points(n: int = 30) -> np.ndarray:
    return np.random.default_rng(19).uniform([-0.2, -0.2, 0.8], [0.8, 0.4, 2.0], size=(n, 3))


def rays_of(p_world: np.ndarray, T_world_camera: np.ndarray) -> np.ndarray:
    p = se3.apply(se3.inverse(T_world_camera)[:, None], p_world)
    return p / np.linalg.norm(p, axis=-1, keepdims=True)


@pytest.mark.parametrize("views", [2, 3, 4])
def test_exact_rays_give_exact_points(views: int) -> None:
    T, p = cameras()[:views], points()
    rays = rays_of(p, T) * np.random.default_rng(20).uniform(0.5, 2, size=(views, len(p), 1))
    found = triangulate(rays, T_world_camera=T)
    np.testing.assert_allclose(found, p, atol=1e-13)
    np.testing.assert_allclose(refine_points(found, rays, T_world_camera=T), p, atol=1e-12)


def test_two_rays_meet_half_way_between_them() -> None:
    T = se3.make(np.stack([np.eye(3)] * 2), np.array([[0, 0, 0], [1.0, 0.1, 0]]))
    rays = np.array([[[0, 0, 1.0]], [[-1, 0, 1.0]]])
    np.testing.assert_allclose(triangulate(rays, T_world_camera=T), [[0, 0.05, 1.0]], atol=1e-14)


def test_unseen_views_do_not_count() -> None:
    T, p = cameras(), points()
    rays = rays_of(p, T)
    rays[0, ::2] = np.nan
    rays[3, 1::2] = np.nan
    found = triangulate(rays, T_world_camera=T)
    np.testing.assert_allclose(found, p, atol=1e-13)
    np.testing.assert_allclose(refine_points(found + 0.01, rays, T_world_camera=T), p, atol=1e-12)


def test_refinement_reaches_a_stationary_point_and_the_better_answer() -> None:
    T, p = cameras(), points(400)
    rng, sigma = np.random.default_rng(21), 1e-3
    rays = rays_of(p, T)
    rays += sigma * rng.normal(size=rays.shape)
    linear = triangulate(rays, T_world_camera=T)
    refined = refine_points(linear, rays, T_world_camera=T)

    def squared_angles(x: np.ndarray) -> np.ndarray:
        unit = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        return np.sum(np.sum(np.cross(rays_of(x, T), unit) ** 2, axis=-1), axis=0)

    for step in 1e-5 * np.vstack([np.eye(3), -np.eye(3)]):
        assert np.all(squared_angles(refined) <= squared_angles(refined + step))
    # With one camera four times as far the linear solution weighs its error sixteen times too much.
    error = {name: np.sqrt(np.mean((x - p) ** 2)) for name, x in (("linear", linear), ("refined", refined))}
    assert error["refined"] < 0.95 * error["linear"]


@pytest.mark.parametrize(
    ("rays", "message"),
    [
        (np.broadcast_to([0, 0, 1.0], (4, 5, 3)).copy(), "point 0: its rays are parallel"),
        (np.full((4, 5, 3), np.nan), "point 0 is seen by 0 views"),
        (np.zeros((4, 5, 3)), "a ray has length 0"),
        (np.ones((3, 5, 3)), r"got \(3, 5, 3\) and \(4, 4, 4\)"),
    ],
    ids=["parallel", "unseen", "zero", "shape"],
)
def test_rays_that_fix_no_point_are_refused(rays: np.ndarray, message: str) -> None:
    T = se3.make(np.stack([np.eye(3)] * 4), np.eye(4)[:, :3])
    with pytest.raises(InputError, match=message):
        triangulate(rays, T_world_camera=T)


def test_refinement_wants_a_start_for_every_point() -> None:
    T, p = cameras(), points(5)
    with pytest.raises(InputError, match=r"\(5, 3\) start points .* got \(4, 3\)"):
        refine_points(p[:4], rays_of(p, T), T_world_camera=T)
