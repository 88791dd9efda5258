"""Intrinsic calibration on synthetic data: exact without noise, honest with it, and of what does not belong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.cameras import Camera
from calibrant.data import Observations, View
from calibrant.errors import InputError, RefusedError
from calibrant.simulate.scenes import IntrinsicsScene, intrinsics_scene, look_at_board, observe
from calibrant.simulate.truth import chi_square


@pytest.fixture(scope="module")
def scene() -> IntrinsicsScene:
    return intrinsics_scene(12, seed=3)


def changed(scene: IntrinsicsScene, **views: View) -> Observations:
    """The scene's observations with some views replaced: v5=… is the view of index 5."""
    every = list(scene.observations.views)
    for name, view in views.items():
        every[int(name[1:])] = view
    return replace(scene.observations, views=tuple(every))


def normalised_error(camera: Camera, truth: Camera) -> float:
    """d^T C^-1 d over the free parameters, chi-square with as many degrees of freedom."""
    free = [i for i, s in enumerate(camera.sigma.values()) if s > 0]
    d = (camera.values - truth.values)[free]
    assert camera.covariance is not None
    return chi_square(d, camera.covariance[np.ix_(free, free)])


def same_optimum(a: Camera, b: Camera) -> bool:
    """Whether two fits ended within a thousandth of their own uncertainty."""
    return bool(np.all(np.abs(a.values - b.values) < 1e-3 * np.array(list(a.sigma.values()))))


LIMIT = float(chi2.ppf(1 - 1e-4, 9))
"""Exceeded by one honest calibration in ten thousand."""


def test_exact_without_noise(scene: IntrinsicsScene) -> None:
    rng = np.random.default_rng(0)
    result = calibrate_intrinsics(observe(scene.camera, scene.points, scene.T_camera_target, sigma_px=0, rng=rng))
    # Rounding: 1e-16 relative on 1000 px, amplified by a condition of some 1e4.
    assert np.abs(result.camera.values - scene.camera.values).max() < 1e-8
    assert result.rms_px is not None
    assert result.rms_px < 1e-9
    for view, T in zip(result.views, scene.T_camera_target):
        assert np.abs(view.T_camera_target - T).max() < 1e-10


@pytest.mark.statistics
def test_errors_are_what_the_covariance_says() -> None:
    errors, sigmas = [], []
    for seed in range(40):
        trial = intrinsics_scene(10, seed=seed)
        result = calibrate_intrinsics(trial.observations)
        errors.append(normalised_error(result.camera, trial.camera))
        sigmas.append(result.sigma_px)
    # The sum of 40 chi-squares of 9 degrees is one of 360: two-sided at 1e-4 each.
    low, high = chi2.ppf([1e-4, 1 - 1e-4], 360)
    assert low < sum(errors) < high
    assert np.mean(sigmas) == pytest.approx(0.1, rel=0.01)  # 40 x 1600 residuals: 0.4 % of one sigma


def test_gross_points_are_left_out_and_named(scene: IntrinsicsScene) -> None:
    view = scene.observations.views[2]
    uv = view.uv.copy()
    uv[[3, 4]] += [40.0, 10.0]
    result = calibrate_intrinsics(changed(scene, v2=replace(view, uv=uv)))
    assert (result.views[2].points, result.views[2].points_left_out) == (86, 2)
    assert result.views[2].reason is not None
    assert result.views[2].reason.startswith("2 of 88 points left out: residual above")
    assert normalised_error(result.camera, scene.camera) < LIMIT


@pytest.mark.parametrize("wrong", [1, 5])
def test_misread_boards_are_left_out(scene: IntrinsicsScene, wrong: int) -> None:
    rng = np.random.default_rng(1)
    views = scene.observations.views
    shuffled = {f"v{i}": replace(views[i], uv=views[i].uv[rng.permutation(len(views[i]))]) for i in range(wrong)}
    result = calibrate_intrinsics(changed(scene, **shuffled))
    assert [v.used for v in result.views] == [False] * wrong + [True] * (12 - wrong)
    assert "the board was misread" in (result.views[0].reason or "")
    assert result.verdict == "warn"
    assert normalised_error(result.camera, scene.camera) < LIMIT


def test_a_board_numbered_from_the_other_end_fits_as_well(scene: IntrinsicsScene) -> None:
    """A flat symmetric grid turned by 180 degrees has another pose and the same camera."""
    view = scene.observations.views[5]
    turned = replace(view, points=view.points.max(axis=0) + view.points.min(axis=0) - view.points)
    result = calibrate_intrinsics(changed(scene, v5=turned))
    assert all(v.used for v in result.views)
    assert same_optimum(result.camera, calibrate_intrinsics(scene.observations).camera)


def test_views_with_too_few_points_are_left_out_with_a_reason(scene: IntrinsicsScene) -> None:
    views, row = scene.observations.views, np.arange(88)
    result = calibrate_intrinsics(changed(scene, v0=views[0].subset(row < 3), v1=views[1].subset(row < 8)))
    assert [v.used for v in result.views[:3]] == [False, False, True]
    assert result.views[0].reason == "3 points, a pose needs 4"
    assert result.views[1].reason == "its 8 points lie on a line, which determines no pose"


def test_what_is_fixed_stays_where_it_was_put(scene: IntrinsicsScene) -> None:
    start = scene.camera
    result = calibrate_intrinsics(scene.observations, fix=["fx", "principal", "k3"], initial=start)
    for name in ("fx", "cx", "cy", "k3"):
        assert result.camera.parameters[name] == start.parameters[name]
        assert result.camera.sigma[name] == 0
    free = calibrate_intrinsics(scene.observations)
    assert result.camera.sigma["fy"] < free.camera.sigma["fy"]
    assert result.options["fix"] == ["fx", "principal", "k3"]


def test_terms_fixed_without_a_start_are_neutral(scene: IntrinsicsScene) -> None:
    result = calibrate_intrinsics(scene.observations, fix=["tangential", "k3"])
    assert [result.camera.parameters[n] for n in ("p1", "p2", "k3")] == [0, 0, 0]
    square = calibrate_intrinsics(scene.observations, fix=["aspect"]).camera
    assert square.parameters["fy"] == pytest.approx(square.parameters["fx"], rel=1e-12)  # square pixels
    assert square.sigma["fy"] == pytest.approx(square.sigma["fx"], rel=1e-12)


def test_the_aspect_of_a_start_is_kept(scene: IntrinsicsScene) -> None:
    ratio = scene.camera.parameters["fy"] / scene.camera.parameters["fx"]
    result = calibrate_intrinsics(scene.observations, fix=["aspect"], initial=scene.camera)
    assert result.camera.parameters["fy"] / result.camera.parameters["fx"] == pytest.approx(ratio, rel=1e-12)
    assert normalised_error(calibrate_intrinsics(scene.observations).camera, scene.camera) < LIMIT


def test_any_start_leads_to_the_same_camera(scene: IntrinsicsScene) -> None:
    far = Camera.create("pinhole", {"fx": 800.0, "fy": 800.0, "cx": 600.0, "cy": 480.0}, image_size=(1280, 1024))
    a = calibrate_intrinsics(scene.observations).camera
    b = calibrate_intrinsics(scene.observations, initial=far).camera
    assert same_optimum(a, b)


def test_a_limit_leaves_out_the_points_above_it(scene: IntrinsicsScene) -> None:
    result = calibrate_intrinsics(scene.observations, max_error_px=0.3)
    lost = sum(v.points_left_out for v in result.views)
    # exp(-0.3^2 / (2 0.1^2)) = 1.1 % of 1056 points: 12, with a spread of 3.4.
    assert 2 <= lost <= 25
    assert result.options["max_error_px"] == 0.3
    with pytest.raises(RefusedError, match=r"every point is above the limit of 1e-06 px.*Raise --max-error"):
        calibrate_intrinsics(scene.observations, max_error_px=1e-6)


def test_a_model_that_does_not_describe_the_lens_is_warned_of(scene: IntrinsicsScene) -> None:
    result = calibrate_intrinsics(scene.observations, model="pinhole")
    assert result.verdict == "warn"
    assert "the pinhole model does not describe this lens" in result.check("reprojection").message


def test_boards_that_are_never_tilted_are_refused() -> None:
    rng = np.random.default_rng(0)
    flat = intrinsics_scene(3)
    T = look_at_board(flat.camera, flat.points, 10, rng=rng, tilt_deg=0.0)
    with pytest.raises(RefusedError, match=r"[Tt]ilt the board 20 to 45 degrees"):
        calibrate_intrinsics(observe(flat.camera, flat.points, T, sigma_px=0.1, rng=rng))


@pytest.mark.parametrize(("fix", "views"), [((), 1), (("aspect",), 1)])
def test_views_too_few_for_what_is_free_are_refused(scene: IntrinsicsScene, fix: tuple[str, ...], views: int) -> None:
    few = scene.observations.only([str(i) for i in range(views)])
    with pytest.raises(RefusedError, match=r"1 usable view cannot determine fx, fy, cx, cy.*--fix principal,aspect"):
        calibrate_intrinsics(few, fix=fix)


def test_a_board_photographed_again_where_it_was_is_one_view(scene: IntrinsicsScene) -> None:
    """Six photos of a board that nobody moved: the noise differs, the conditions are those of one."""
    rng = np.random.default_rng(5)
    first = scene.observations.views[0]
    again = [
        replace(first, id=f"{i}", moment="", uv=first.uv + rng.normal(scale=0.1, size=first.uv.shape)) for i in range(6)
    ]
    with pytest.raises(RefusedError, match=r"1 usable view \(6 given, the others show the board where it was\) cannot"):
        calibrate_intrinsics(replace(scene.observations, views=tuple(again)))


def test_a_view_without_points_is_left_out_and_named(scene: IntrinsicsScene) -> None:
    nothing = replace(scene.observations.views[0].subset(np.zeros(88, dtype=bool)), id="nothing", moment="")
    result = calibrate_intrinsics(replace(scene.observations, views=(*scene.observations.views, nothing)))
    (view,) = [v for v in result.views if v.id == "nothing"]
    assert not view.used
    assert result.rms_px == calibrate_intrinsics(scene.observations).rms_px


def test_one_view_determines_a_focal_length(scene: IntrinsicsScene) -> None:
    one = scene.observations.only(["4"])
    result = calibrate_intrinsics(one, fix=["aspect", "principal"])
    assert result.verdict == "warn"
    assert result.camera.parameters["fx"] == pytest.approx(1101, rel=0.1)


def test_unusable_input_is_named(scene: IntrinsicsScene) -> None:
    with pytest.raises(InputError, match="no view with 4 points or more"):
        calibrate_intrinsics(replace(scene.observations, views=()))
    first = scene.observations.views[0]
    few = replace(first, id="few", points=first.points[:3], uv=first.uv[:3], point_ids=first.point_ids[:3])
    with pytest.raises(InputError, match=r"\(few: 3 points, a pose needs 4\)"):
        calibrate_intrinsics(replace(scene.observations, views=(few,)))
    with pytest.raises(InputError, match="cannot fix 'k9'"):
        calibrate_intrinsics(scene.observations, fix=["k9"])
    with pytest.raises(InputError, match="unknown camera model 'lens'"):
        calibrate_intrinsics(scene.observations, model="lens")
    with pytest.raises(InputError, match="--initial"):
        calibrate_intrinsics(scene.observations, fix=["focal"])
    two = replace(scene.observations, image_sizes={"a": (1, 1), "camera": (1280, 1024)})
    with pytest.raises(InputError, match="takes one camera"):
        calibrate_intrinsics(two)
