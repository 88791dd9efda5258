"""What every registered camera model must hold: shapes, inverses, derivatives, the field it sees, the compiled form.

A new model is covered by its line in the registry, with ordinary values of its terms; models whose terms have a scale
of their own give them in TERMS.
"""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.cameras import MODELS, Camera, CameraModel, camera_model
from calibrant.errors import InputError

IMAGE_SIZE = (1280, 1024)
SHAPES = [(), (7,), (2, 3)]
PIXELS = {"fx": 900.0, "fy": 905.0, "cx": 645.0, "cy": 507.0, "skew": 0.7}
TERMS = {
    "kannala_brandt": {"k1": -0.02, "k2": 0.004, "k3": -0.001, "k4": 0.0002},
    "unified": {"xi": 1.2, "k1": -0.1, "k2": 0.02, "p1": 0.001, "p2": -0.002},
    "extended_unified": {"alpha": 0.6, "beta": 1.1},
    "double_sphere": {"xi": -0.2, "alpha": 0.58},
    "division": {"l1": -0.25, "l2": -0.01, "l3": -0.003},
}
REACH_DEG = {"perspective": 85.0, "central": 60.0, "parallel": 85.0}
"""Some points farther than this from the axis are seen by every model of the kind."""


@pytest.fixture(params=sorted(MODELS))
def model(request: pytest.FixtureRequest) -> CameraModel:
    return MODELS[request.param]


@pytest.fixture
def parameters(model: CameraModel) -> np.ndarray:
    """Parameters of an ordinary lens: distortion terms of a few percent, every one different from zero."""
    rng = np.random.default_rng(22)
    terms = rng.uniform(0.01, 0.05, len(model.parameter_names)) * rng.choice([-1, 1], len(model.parameter_names))
    given = {**PIXELS, **TERMS.get(model.name, {})}
    return np.array([given.get(name, term) for name, term in zip(model.parameter_names, terms)])


def points(shape: tuple[int, ...], seed: int = 23) -> np.ndarray:
    """Camera-frame points (*shape, 3), metres, within 27 degrees of the axis."""
    rng = np.random.default_rng(seed)
    xy, z = rng.uniform(-0.35, 0.35, (*shape, 2)), rng.uniform(0.3, 2, (*shape, 1))
    return np.concatenate([xy * z, z], axis=-1)


def everywhere(n: int, seed: int = 29) -> np.ndarray:
    """Points (n, 3) in all directions at depths of a lab."""
    rng = np.random.default_rng(seed)
    d = rng.normal(size=(n, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True) * rng.uniform(0.2, 3, (n, 1))


def valid_points(model: CameraModel, parameters: np.ndarray, n: int = 4000) -> np.ndarray:
    """Those of `everywhere` in the valid field whose pixels lie within four images of the centre."""
    p = everywhere(n)
    p = p[model.valid(parameters, p)]
    return p[np.abs(model.project(parameters, p) - parameters[2:4]).max(axis=1) < 4 * IMAGE_SIZE[0]]


def angle_deg(p: np.ndarray) -> np.ndarray:
    return np.rad2deg(np.arctan2(np.hypot(p[..., 0], p[..., 1]), p[..., 2]))


def test_registry_names_and_parameters_agree(model: CameraModel) -> None:
    assert MODELS[model.name] is model
    assert camera_model(model.name) is model
    assert len(set(model.parameter_names)) == len(model.parameter_names) == len(model.parameter_units)
    assert model.parameter_names[:4] == ("fx", "fy", "cx", "cy")
    assert set(model.parameter_units) <= {"px", "px/m", "rad", "1"}
    assert model.summary
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
    assert model.unproject(parameters, uv).shape == model.ray_origins(parameters, uv).shape == (*shape, 3)
    assert model.sees(parameters, p).shape == model.valid(parameters, p).shape == shape


def test_batch_equals_loop(model: CameraModel, parameters: np.ndarray) -> None:
    p = points((20,))
    uv, J_point, J_parameters = model.project_with_jacobians(parameters, p)
    for i in range(len(p)):
        # Implicit models stop their batch together: a pixel may take one more step of rounding than alone.
        np.testing.assert_allclose(model.project(parameters, p[i]), uv[i], rtol=1e-13)
        one = model.project_with_jacobians(parameters, p[i])
        np.testing.assert_allclose(one[1], J_point[i], rtol=1e-12, atol=1e-10)
        np.testing.assert_allclose(one[2], J_parameters[i], rtol=1e-12, atol=1e-10)


def test_rays_lead_back_to_the_points_over_the_whole_valid_field(model: CameraModel, parameters: np.ndarray) -> None:
    p = valid_points(model, parameters)
    assert len(p) > 500
    uv = model.project(parameters, p)
    ray, origin = model.unproject(parameters, uv), model.ray_origins(parameters, uv)
    np.testing.assert_allclose(np.linalg.norm(ray, axis=-1), 1, atol=1e-14)
    np.testing.assert_allclose(model.project(parameters, origin + ray), uv, atol=1e-9, rtol=0)
    # Rounding of a pixel, 1e-12 px, over the focal length; the map flattens towards the rim of the field.
    inner = angle_deg(p) < 50
    sight = p - origin
    sight /= np.linalg.norm(sight, axis=-1, keepdims=True)
    np.testing.assert_allclose(ray[inner], sight[inner], atol=1e-11)


def test_the_valid_field_is_that_of_a_lens(model: CameraModel, parameters: np.ndarray) -> None:
    p = everywhere(2000)
    assert np.any(model.sees(parameters, p[angle_deg(p) > REACH_DEG[model.projection]]))
    assert np.all(model.valid(parameters, p[angle_deg(p) < 35]))
    assert not np.any(model.valid(parameters, p) & ~model.sees(parameters, p))


def test_no_ray_is_invented(model: CameraModel, parameters: np.ndarray) -> None:
    """Wherever a pixel has a ray, even far outside of the image, that ray is valid and leads to the pixel."""
    rng = np.random.default_rng(31)
    uv = rng.uniform(-3000, 4000, (3000, 2))
    ray = model.unproject(parameters, uv)
    known = np.isfinite(ray).all(axis=1)
    np.testing.assert_array_equal(np.isnan(ray).any(axis=1), ~known)
    found = model.ray_origins(parameters, uv[known]) + ray[known]
    np.testing.assert_allclose(model.project(parameters, found), uv[known], atol=1e-9, rtol=0)


def test_many_pixels_get_the_same_rays_as_few(model: CameraModel, parameters: np.ndarray) -> None:
    """From 20 000 pixels on the compiled inverse runs."""
    rng = np.random.default_rng(32)
    uv = rng.uniform(-600, 1900, (20_500, 2))
    many, few = model.unproject(parameters, uv), model.unproject(parameters, uv[:2000])
    np.testing.assert_allclose(many[:2000], few, atol=1e-11)
    known = np.isfinite(many).all(axis=1)
    found = model.ray_origins(parameters, uv[known]) + many[known]
    np.testing.assert_allclose(model.project(parameters, found), uv[known], atol=1e-9, rtol=0)


def test_project_inverts_unproject_at_every_depth(model: CameraModel, parameters: np.ndarray) -> None:
    grid = np.stack(np.meshgrid(np.linspace(350, 950, 13), np.linspace(250, 750, 11)), axis=-1)
    ray, origin = model.unproject(parameters, grid), model.ray_origins(parameters, grid)
    for depth in (0.1, 1.0, 50.0):
        np.testing.assert_allclose(model.project(parameters, origin + depth * ray), grid, atol=1e-9)


def test_points_at_infinity_have_no_pixel(model: CameraModel, parameters: np.ndarray) -> None:
    """Nor do points of NaN; and nothing warns."""
    p = points((9,))
    for i, value in enumerate([np.inf, -np.inf, np.nan] * 3):
        p[i, i // 3] = value
    assert not np.any(model.sees(parameters, p))
    assert not np.any(model.valid(parameters, p))
    uv, J_point, _ = model.project_with_jacobians(parameters, p)
    assert np.all(np.isnan(uv))
    assert np.all(np.isnan(model.project(parameters, p)))
    assert np.all(np.isnan(J_point).any(axis=(1, 2)))
    assert np.all(np.isnan(model.unproject(parameters, [[np.inf, 100.0], [np.nan, 100.0], [100.0, -np.inf]])))


def test_points_that_it_does_not_see_have_no_pixel(model: CameraModel, parameters: np.ndarray) -> None:
    p = np.concatenate([everywhere(500), [[0.0, 0.0, -1.0]]])
    seen = model.sees(parameters, p)
    assert 0 < seen.sum() < len(p)
    uv, J_point, J_parameters = model.project_with_jacobians(parameters, p)
    np.testing.assert_array_equal(np.isnan(uv).any(axis=1), ~seen)
    np.testing.assert_array_equal(np.isnan(model.project(parameters, p)).all(axis=1), ~seen)
    assert np.all(np.isfinite(J_point[seen]))
    assert np.all(np.isfinite(J_parameters[seen]))


def test_jacobians_against_central_differences(model: CameraModel, parameters: np.ndarray) -> None:
    p = valid_points(model, parameters, 600)
    p = p[model.valid(parameters, p * [1.02, 1.02, 1.0]) & (np.linalg.norm(p, axis=1) > 0.5)]
    p = np.concatenate([p[angle_deg(p) < 60][:60], p[angle_deg(p) > 95][:20], points((20,))])
    uv, J_point, J_parameters = model.project_with_jacobians(parameters, p)
    np.testing.assert_allclose(uv, model.project(parameters, p), rtol=1e-13)
    # With h = 1e-5 of a metre, pixels of 1e3 round to 1e-13 / h = 1e-8; truncation is h^2 = 1e-10 times the slopes.
    for i, e in enumerate(np.eye(3)):
        h = 1e-5
        difference = (model.project(parameters, p + h * e) - model.project(parameters, p - h * e)) / (2 * h)
        np.testing.assert_allclose(J_point[..., i], difference, rtol=1e-6, atol=1e-6 * np.abs(J_point).max())
    some = range(len(parameters)) if len(parameters) < 40 else range(0, len(parameters), 17)
    for i in some:
        h = 1e-6 * max(1.0, abs(parameters[i])) * np.eye(len(parameters))[i]
        difference = (model.project(parameters + h, p) - model.project(parameters - h, p)) / (2 * h[i])
        column = J_parameters[..., i]
        np.testing.assert_allclose(column, difference, rtol=1e-6, atol=1e-6 * max(1.0, np.abs(column).max()))


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
    if n:
        p[0, :2] = 0.0  # the axis, where radial models take a limit
    uv, J_point, J_parameters = model.project_with_jacobians(parameters, p)
    unseen, (uv_rows, point_rows, parameter_rows) = compiled(model, parameters, p, room=n + 5)
    assert unseen == 0
    # Both are the same sums in another order: a few roundings of values up to 1e4.
    np.testing.assert_allclose(uv_rows[:, :n].T, uv, rtol=1e-12)
    np.testing.assert_allclose(point_rows[:, :n].T.reshape(n, 2, 3), J_point, rtol=1e-11, atol=1e-9)
    np.testing.assert_allclose(parameter_rows[:, :n].T.reshape(J_parameters.shape), J_parameters, rtol=1e-11, atol=1e-9)
    for rows in (uv_rows, point_rows, parameter_rows):
        assert np.all(rows[:, n:] == 7.0)


def test_local_rows_are_the_compiled_rows_without_their_zeros(model: CameraModel, parameters: np.ndarray) -> None:
    found = model.local_rows()
    if found is None:
        return
    rows, local = found
    n, k = 60, len(parameters)
    p = np.concatenate([points((n - 1,)), [[0.0, 0.0, -1.0]]])
    unseen, (uv, J_point, J_parameters) = compiled(model, parameters, p, room=n)
    index, J_local = np.full((n, 2, local), -1), np.full((n, 2, local), 7.0)
    out = np.full((2, n), 7.0), np.full((6, n), 7.0)
    assert rows(n, parameters, np.ascontiguousarray(p.T), *out, index, J_local) == unseen == 1
    np.testing.assert_array_equal(out[0], uv)
    np.testing.assert_array_equal(out[1], J_point)
    assert np.all(np.diff(index[:-1], axis=-1) > 0)
    dense = np.zeros((n, 2, k))
    np.put_along_axis(dense, index, J_local, axis=-1)
    np.testing.assert_array_equal(dense[:-1].transpose(1, 2, 0).reshape(2 * k, -1), J_parameters[:, :-1])


def test_compiled_rows_count_what_they_cannot_see(model: CameraModel, parameters: np.ndarray) -> None:
    p = np.concatenate([everywhere(300), [[0.0, 0.0, -1.0]]])
    seen = model.sees(parameters, p)
    unseen, (uv_rows, point_rows, _) = compiled(model, parameters, p, room=len(p))
    assert unseen == np.sum(~seen)
    np.testing.assert_array_equal(np.isnan(uv_rows).any(axis=0), ~seen)
    np.testing.assert_array_equal(np.isnan(point_rows).any(axis=0), ~seen)


def test_a_start_has_the_focal_length_asked_for(model: CameraModel) -> None:
    values = model.starting_values(700.0, np.array([640.0, 512.0]))
    uv, J_point, _ = model.project_with_jacobians(values, [0.0, 0.0, 1.0])
    np.testing.assert_allclose(uv, [640, 512], atol=1e-12)
    np.testing.assert_allclose(J_point[:, :2], 700 * np.eye(2), rtol=1e-12)


def test_camera_carries_the_model(model: CameraModel, parameters: np.ndarray) -> None:
    named = dict(zip(model.parameter_names, parameters.tolist()))
    camera = Camera.create(model.name, named, image_size=IMAGE_SIZE)
    assert camera.parameters == named
    np.testing.assert_array_equal(camera.project(points((5,))), model.project(parameters, points((5,))))
