"""What every registered camera model must hold: shapes, inverses, derivatives and the compiled form.

Nothing here names a model: a new one is covered by its line in the registry.
"""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.cameras import MODELS, Camera, CameraModel
from calibrant.errors import InputError

IMAGE_SIZE = (1280, 1024)
SHAPES = [(), (7,), (2, 3)]
PIXELS = {"fx": 900.0, "fy": 905.0, "cx": 645.0, "cy": 507.0}
"""Values of the parameters in pixels that all models share; any other one in pixels is a small offset."""


@pytest.fixture(params=sorted(MODELS))
def model(request: pytest.FixtureRequest) -> CameraModel:
    return MODELS[request.param]


@pytest.fixture
def parameters(model: CameraModel) -> np.ndarray:
    """Parameters of an ordinary lens: distortion terms of a few percent, every one different from zero."""
    rng = np.random.default_rng(22)
    terms = rng.uniform(0.01, 0.05, len(model.parameter_names)) * rng.choice([-1, 1], len(model.parameter_names))
    return np.array([PIXELS.get(name, term) for name, term in zip(model.parameter_names, terms)])


def points(shape: tuple[int, ...], seed: int = 23) -> np.ndarray:
    """Camera-frame points (*shape, 3), metres, within 27 degrees of the axis."""
    rng = np.random.default_rng(seed)
    xy, z = rng.uniform(-0.35, 0.35, (*shape, 2)), rng.uniform(0.3, 2, (*shape, 1))
    return np.concatenate([xy * z, z], axis=-1)


def test_registry_names_and_parameters_agree(model: CameraModel) -> None:
    assert MODELS[model.name] is model
    assert len(set(model.parameter_names)) == len(model.parameter_names) == len(model.parameter_units)
    assert set(model.parameter_units) <= {"px", "1"}
    for i, name in enumerate(model.parameter_names):
        assert model.index(name) == i
    with pytest.raises(InputError, match=model.parameter_names[0]):
        model.index("no-such-parameter")


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_shapes_follow_the_batch(model: CameraModel, parameters: np.ndarray, shape: tuple[int, ...]) -> None:
    p, k = points(shape), len(parameters)
    uv, J_point, J_parameters = model.project_with_jacobians(parameters, p)
    assert model.project(parameters, p).shape == uv.shape == (*shape, 2)
    assert J_point.shape == (*shape, 2, 3)
    assert J_parameters.shape == (*shape, 2, k)
    assert model.unproject(parameters, uv).shape == (*shape, 3)


def test_batch_equals_loop(model: CameraModel, parameters: np.ndarray) -> None:
    p = points((20,))
    uv, J_point, J_parameters = model.project_with_jacobians(parameters, p)
    for i in range(len(p)):
        np.testing.assert_allclose(model.project(parameters, p[i]), uv[i], rtol=1e-14)
        one = model.project_with_jacobians(parameters, p[i])
        np.testing.assert_allclose(one[1], J_point[i], rtol=1e-13, atol=1e-11)
        np.testing.assert_allclose(one[2], J_parameters[i], rtol=1e-13, atol=1e-11)


def test_unproject_inverts_project(model: CameraModel, parameters: np.ndarray) -> None:
    p = points((500,))
    ray = model.unproject(parameters, model.project(parameters, p))
    np.testing.assert_allclose(np.linalg.norm(ray, axis=-1), 1, atol=1e-14)
    # Rounding of a pixel, 1e-13 px, over the focal length, with room for an iterative inverse that stops at 1e-14.
    np.testing.assert_allclose(ray, p / np.linalg.norm(p, axis=-1, keepdims=True), atol=1e-12)


def test_project_inverts_unproject_at_every_depth(model: CameraModel, parameters: np.ndarray) -> None:
    grid = np.stack(np.meshgrid(np.linspace(350, 950, 13), np.linspace(250, 750, 11)), axis=-1)
    ray = model.unproject(parameters, grid)
    for depth in (0.1, 1.0, 50.0):
        np.testing.assert_allclose(model.project(parameters, depth * ray), grid, atol=1e-9)


def test_points_behind_have_no_pixel(model: CameraModel, parameters: np.ndarray) -> None:
    p = points((4,))
    p[1] = [0.05, -0.02, -0.7]
    uv, J_point, J_parameters = model.project_with_jacobians(parameters, p)
    seen = [0, 2, 3]
    assert np.all(np.isnan(uv[1]))
    assert np.all(np.isnan(model.project(parameters, p)[1]))
    assert np.all(np.isfinite(uv[seen]))
    assert np.all(np.isfinite(J_point[seen]))
    assert np.all(np.isfinite(J_parameters[seen]))


def test_jacobians_against_central_differences(model: CameraModel, parameters: np.ndarray) -> None:
    p = points((50,))
    uv, J_point, J_parameters = model.project_with_jacobians(parameters, p)
    np.testing.assert_allclose(uv, model.project(parameters, p), rtol=1e-14)
    # With h = 1e-6 of a metre or of the parameter, pixels of 1e3 round to 1e-13 / h = 1e-7; truncation is below 1e-8.
    for i, e in enumerate(np.eye(3)):
        h = 1e-6
        difference = (model.project(parameters, p + h * e) - model.project(parameters, p - h * e)) / (2 * h)
        np.testing.assert_allclose(J_point[..., i], difference, rtol=1e-7, atol=1e-5)
    for i, e in enumerate(np.eye(len(parameters))):
        h = 1e-6 * max(1.0, abs(parameters[i]))
        difference = (model.project(parameters + h * e, p) - model.project(parameters - h * e, p)) / (2 * h)
        np.testing.assert_allclose(J_parameters[..., i], difference, rtol=1e-7, atol=1e-6)


def compiled(model: CameraModel, parameters: np.ndarray, p: np.ndarray, room: int) -> tuple[int, list[np.ndarray]]:
    """The compiled rows on points (n, 3), in buffers with room for more; a mark of 7 shows what is untouched."""
    k = len(parameters)
    xyz = np.full((3, room), 7.0)
    xyz[:, : len(p)] = p.T
    out = [np.full((rows, room), 7.0) for rows in (2, 6, 2 * k)]
    return model.rows()(len(p), parameters, xyz, *out), out


@pytest.mark.parametrize("n", [0, 1, 4, 37])
def test_compiled_rows_equal_the_numpy_form(model: CameraModel, parameters: np.ndarray, n: int) -> None:
    p = points((n,))
    uv, J_point, J_parameters = model.project_with_jacobians(parameters, p)
    unseen, (uv_rows, point_rows, parameter_rows) = compiled(model, parameters, p, room=n + 5)
    assert unseen == 0
    # Both are the same sums in another order: a few roundings of values up to 1e4.
    np.testing.assert_allclose(uv_rows[:, :n].T, uv, rtol=1e-13)
    np.testing.assert_allclose(point_rows[:, :n].T.reshape(n, 2, 3), J_point, rtol=1e-12, atol=1e-10)
    np.testing.assert_allclose(
        parameter_rows[:, :n].T.reshape(J_parameters.shape), J_parameters, rtol=1e-12, atol=1e-10
    )
    for rows in (uv_rows, point_rows, parameter_rows):
        assert np.all(rows[:, n:] == 7.0)


def test_compiled_rows_count_what_they_cannot_see(model: CameraModel, parameters: np.ndarray) -> None:
    p = points((9,))
    p[[2, 5, 8], 2] *= -1
    unseen, (uv_rows, point_rows, _) = compiled(model, parameters, p, room=9)
    assert unseen == 3
    np.testing.assert_array_equal(np.isnan(uv_rows).any(axis=0), np.isin(np.arange(9), [2, 5, 8]))
    np.testing.assert_array_equal(np.isnan(point_rows).any(axis=0), np.isin(np.arange(9), [2, 5, 8]))


def test_camera_carries_the_model(model: CameraModel, parameters: np.ndarray) -> None:
    named = dict(zip(model.parameter_names, parameters.tolist()))
    camera = Camera.create(model.name, named, image_size=IMAGE_SIZE)
    assert camera.parameters == named
    np.testing.assert_array_equal(camera.project(points((5,))), model.project(parameters, points((5,))))
