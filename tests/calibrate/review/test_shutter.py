"""Images sheared along their rows: alike in all views, each by itself, or not at all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import calibrant as cb
from calibrant.data import Observations
from calibrant.simulate.scenes import IMAGE_SIZE, intrinsics_scene

HEIGHT = IMAGE_SIZE[1]
VIEWS = 20


def _shifted(observations: Observations, shift: Callable[[int], np.ndarray]) -> Observations:
    """Rows shifted by shift(view) (2,) px over the image's height."""
    views = tuple(
        replace(v, uv=v.uv + (v.uv[:, 1:] - 0.5 * HEIGHT) / HEIGHT * shift(i)) for i, v in enumerate(observations.views)
    )
    return replace(observations, views=views)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_still_images_are_not_sheared(seed: int) -> None:
    result = cb.calibrate_intrinsics(intrinsics_scene(VIEWS, seed=seed).observations)
    assert result.check("image-shear").message == "the image's rows are not shifted against each other"
    assert result.check("shutter").message == "no view is sheared along its rows by itself"


def test_a_shear_of_all_views_is_sized() -> None:
    data = _shifted(intrinsics_scene(VIEWS, seed=3).observations, lambda _: np.array([0.004 * HEIGHT, 0.0]))
    check = cb.calibrate_intrinsics(data).check("image-shear")
    assert "the image is sheared along its rows by 0.39 %" in check.message
    assert check.value == pytest.approx(0.004, rel=0.1)
    assert "rolling shutter" in check.message


def test_views_that_moved_each_by_itself_are_named() -> None:
    rng = np.random.default_rng(4)
    shifts = 3.0 * rng.normal(size=(VIEWS, 2))
    shifts[5] = [12.0, -9.0]
    data = _shifted(intrinsics_scene(VIEWS, seed=4).observations, lambda i: shifts[i])
    check = cb.calibrate_intrinsics(data).check("shutter")
    assert check.status == "ok"
    assert "each by itself" in check.message
    assert "most: 5" in check.message
    assert "the uncertainties hold it" in check.message
