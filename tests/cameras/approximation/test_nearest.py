"""A camera in the words of another model: exact where these suffice, the nearest and its error where they do not."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.cameras import Camera
from calibrant.cameras.approximation.nearest import in_words_of, nearest, nearest_of, nearest_to_rays
from calibrant.errors import InputError

PLAIN = {"fx": 410.0, "fy": 412.0, "cx": 321.0, "cy": 237.0}
SIZE = (640, 480)


def _camera(model: str, **terms: float) -> Camera:
    return Camera.create(model, PLAIN | terms, image_size=SIZE)


def _pixels() -> np.ndarray:
    return np.stack(np.meshgrid(np.linspace(5, 630, 7), np.linspace(5, 470, 6)), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize(
    ("camera", "models", "expected"),
    [
        (_camera("brown", k1=-0.1), ("pinhole", "rational"), "rational"),
        (_camera("brown"), ("pinhole", "rational"), "pinhole"),
        (_camera("tilted", k1=-0.1, p1=1e-3), ("pinhole", "brown"), "brown"),
        (_camera("rational", k1=-0.1, k4=0.01), ("pinhole", "brown"), None),
        (_camera("kannala_brandt", k1=0.01), ("pinhole", "brown"), None),
        (_camera("unified", xi=0.0, k1=-0.1), ("brown",), "brown"),
    ],
)
def test_the_same_camera_in_other_words(camera: Camera, models: tuple[str, ...], expected: str | None) -> None:
    same = in_words_of(camera, models)
    assert (same.model.name if same else None) == expected
    if same is not None:
        rays = camera.unproject(_pixels())
        np.testing.assert_allclose(same.project(rays), _pixels(), atol=1e-9)


def test_terms_of_one_name_in_models_of_another_kind_are_not_taken_for_each_other() -> None:
    assert in_words_of(_camera("kannala_brandt", k1=0.01), ("brown",)) is None


def test_the_nearest_says_its_error_over_the_image() -> None:
    wide = _camera("double_sphere", xi=-0.2, alpha=0.55)
    found = nearest(wide, "kannala_brandt")
    away = np.linalg.norm(found.camera.project(wide.unproject(_pixels())) - _pixels(), axis=-1)
    assert 0 < found.rms_px < 1e-3
    assert away.max() <= 1.1 * found.most_px
    assert not found.exact
    assert found.outside == 0


def test_a_richer_model_is_nearer() -> None:
    wide = _camera("kannala_brandt", k1=0.02)
    plain, brown = nearest(wide, "pinhole"), nearest(wide, "rational")
    assert brown.rms_px < plain.rms_px
    assert nearest_of(wide, ("pinhole", "double_sphere")).camera.model.name == "double_sphere"


def test_the_covariance_goes_along() -> None:
    """Moved by one sigma in fx, the nearest camera moves by its own."""
    covariance = np.diag([0.5**2, 0.5**2, 0.3**2, 0.3**2, 0, 0, 0, 0])
    terms = PLAIN | {"k1": 0.02}
    camera = Camera.create("kannala_brandt", terms, image_size=SIZE, covariance=covariance)
    near = nearest(camera, "double_sphere").camera
    moved = Camera.create("kannala_brandt", terms | {"cx": terms["cx"] + 0.3}, image_size=SIZE)
    step = nearest(moved, "double_sphere").camera.parameters["cx"] - near.parameters["cx"]
    assert near.sigma["cx"] == pytest.approx(abs(step), rel=0.02)


def test_models_that_see_nothing_of_it_are_refused() -> None:
    with pytest.raises(InputError, match="none of"):
        nearest_of(_camera("brown"), ())


def test_a_term_that_is_lacking_stays_neutral() -> None:
    camera = _camera("brown", k1=-0.2, k2=0.05, k3=0.02)
    found = nearest(camera, "brown", lacks=("k3",))
    assert found.camera.parameters["k3"] == 0
    assert 0 < found.most_px < nearest(camera, "pinhole").most_px
    assert nearest(_camera("brown", k1=-0.2), "brown", lacks=("k3",)).exact


def test_a_camera_by_its_rays_is_found_again() -> None:
    camera = _camera("kannala_brandt", k1=0.02, k2=-0.004)
    uv = _pixels()
    centre = np.array([320.0, 240.0])
    found = nearest_to_rays(
        uv, camera.unproject(uv), model="kannala_brandt", image_size=SIZE, focal_px=400.0, centre=centre
    )
    assert found.most_px < 1e-6
    np.testing.assert_allclose(found.camera.values[:4], camera.values[:4], atol=1e-4)
    with pytest.raises(InputError, match="sees nothing of what these pixels see"):
        nearest_to_rays(uv, -camera.unproject(uv), model="pinhole", image_size=SIZE, focal_px=400.0, centre=centre)


def test_a_spline_spans_the_image_whatever_its_width() -> None:
    found = nearest(_camera("kannala_brandt", k1=0.02, k2=-0.004), "splined")
    assert found.outside == 0
    assert found.most_px < 0.05
    assert in_words_of(found.camera, ("splined",)) is found.camera
