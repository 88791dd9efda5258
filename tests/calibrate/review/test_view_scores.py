"""Scores of views: their derivatives, and what they find, against full fits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calibrant as cb
from calibrant.calibrate.intrinsics.one_model import calibrate_keeping
from calibrant.calibrate.review.residuals import fitted_poses
from calibrant.calibrate.review.splits import _explained
from calibrant.calibrate.review.view_scores import (
    BEND,
    CENTRE,
    SKEW,
    STRETCH,
    ZOOM,
    ViewScores,
    estimate,
    kept_columns,
    only_in,
    own_of_views,
    rows_of,
    view_scores,
)
from calibrant.data import CalibrationResult, Observations
from calibrant.geometry import se3
from calibrant.simulate.scenes import intrinsics_scene

HEIGHT = 1024


def _scores(result: CalibrationResult) -> ViewScores:
    rows = rows_of(result, "camera", fitted_poses(result))
    assert rows is not None
    scores = view_scores(rows)
    assert scores is not None
    return scores


def _moved(observations: Observations, uv: list[np.ndarray]) -> Observations:
    views = tuple(replace(v, uv=u) for v, u in zip(observations.views, uv, strict=True))
    return replace(observations, views=views)


@pytest.mark.parametrize(
    ("name", "size"),
    [(ZOOM, [2e-5]), (CENTRE, [0.02, -0.03]), (BEND, [0.02, 0.01, -0.03]), (STRETCH, [3e-5]), (SKEW, [0.02, -0.03])],
)
def test_a_small_fault_of_any_kind_is_found_at_its_size(name: str, size: list[float]) -> None:
    """Exact pixels of the true lens, with the fault in every view (what is a view's own: in half of them)."""
    scene = intrinsics_scene(12, seed=1, sigma_px=0.0)
    camera, T, P = scene.camera, scene.T_camera_target, scene.points
    centre = np.array([camera.parameters["cx"], camera.parameters["cy"]])
    half = np.arange(12) >= 6 if name in (ZOOM, CENTRE, SKEW) else np.ones(12, dtype=bool)
    points = P.copy()
    if name == BEND:
        x, y = (2 * (P - P.min(axis=0)) / np.maximum(np.ptp(P, axis=0), 1e-9) - 1).T[:2]
        points[:, 2] = 1e-3 * np.stack([1 - x**2, x * y, 1 - y**2], axis=-1) @ size
    if name == STRETCH:
        points[:, 0] *= 1 + size[0]
    uv = []
    for pose, chosen in zip(T, half):
        seen = camera.project(se3.apply(pose, points))
        if name == ZOOM:
            seen = seen + chosen * size[0] * (seen - centre)
        if name == CENTRE:
            seen = seen + chosen * np.array(size)
        if name == SKEW:
            seen = seen + chosen * (seen[:, 1:] - centre[1]) / HEIGHT * size
        uv.append(seen)
    result = calibrate_keeping(_moved(scene.observations, uv)).result
    scores = _scores(result)
    columns, own = kept_columns(scores, name)
    found = estimate(scores, columns, only_in(scores, columns, own, half))
    assert found is not None
    np.testing.assert_allclose(found.value[own], size, rtol=0.02, atol=0.01 * np.abs(size).max())


def test_own_lenses_of_clean_views_are_chi_square_and_leaving_out_bears_out_the_covariance() -> None:
    squares, freedom, ratios = 0.0, 0.0, []
    for seed in range(12):
        scores = _scores(calibrate_keeping(intrinsics_scene(16, seed=seed).observations).result)
        lenses = own_of_views(scores, ZOOM, CENTRE)
        squares, freedom = squares + lenses.squares.sum(), freedom + lenses.freedom.sum()
        columns, own = kept_columns(scores, ZOOM, CENTRE)
        second = np.arange(16) % 2 == 1
        found = estimate(scores, columns, only_in(scores, columns, own, second), leave_out=True)
        assert found is not None
        assert found.moved is not None
        spread = 15 / 16 * np.sum(found.moved[:, own] ** 2, axis=0)
        ratios.append(spread / np.diag(found.covariance)[own])
    assert abs(squares / freedom - 1) < 4 * np.sqrt(2 / freedom)
    assert 0.7 < np.median(ratios) < 1.6  # a jackknife of 16 views is a little wide


def test_leaving_a_view_out_is_what_leaving_it_out_gives() -> None:
    scores = _scores(calibrate_keeping(intrinsics_scene(9, seed=4).observations).result)
    columns, own = kept_columns(scores, ZOOM)
    weights = only_in(scores, columns, own, np.arange(9) >= 4)
    found = estimate(scores, columns, weights, leave_out=True)
    keep = np.arange(9) != 2
    without = estimate(replace(scores, ids=scores.ids[:8], gram=scores.gram[keep]), columns, weights[keep])
    assert found is not None
    assert without is not None
    assert found.moved is not None
    np.testing.assert_allclose(found.value + found.moved[2], without.value, rtol=1e-6, atol=1e-9)


def test_a_camera_that_was_given_has_no_scores() -> None:
    result = calibrate_keeping(intrinsics_scene(6).observations).result
    given = replace(result, cameras={"camera": replace(result.camera, covariance=None)})
    assert rows_of(given, "camera", fitted_poses(given)) is None


@pytest.mark.parametrize("own", [(ZOOM,), (CENTRE,)])
def test_partings_asked_at_once_say_what_each_says_by_itself(own: tuple[str, ...]) -> None:
    scores = _scores(cb.calibrate_intrinsics(intrinsics_scene(12, seed=2).observations))
    masks = [np.arange(12) >= at for at in range(3, 10)] + [np.zeros(12, dtype=bool)]  # the last tells nothing
    columns, mine = kept_columns(scores, *own)
    each = [estimate(scores, columns, only_in(scores, columns, mine, mask)) for mask in masks]
    expected = [0.0 if found is None else found.chi_square(mine) for found in each]
    assert expected[-1] == 0 < min(expected[:-1])
    np.testing.assert_allclose(_explained(scores, columns, mine, np.array(masks, dtype=float)), expected, rtol=1e-9)
