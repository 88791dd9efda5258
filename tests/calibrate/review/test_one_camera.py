"""Is it one camera? Groups of views with lenses of their own are named, clean and real sets are left in peace."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.calibrate.intrinsics.one_model import calibrate_keeping
from calibrant.calibrate.review.splits import named_splits
from calibrant.data import Observations
from calibrant.errors import RefusedError
from calibrant.simulate.scenes import IMAGE_SIZE, intrinsics_scene

VIEWS = 16
Change = Callable[[np.ndarray], np.ndarray]
CENTRE = (np.array(IMAGE_SIZE) - 1) / 2


def _scaled(factor: float) -> Change:
    return lambda uv: CENTRE + factor * (uv - CENTRE)


def _cropped(uv: np.ndarray) -> np.ndarray:
    return uv - [50.0, -40.0]


def _mirrored(uv: np.ndarray) -> np.ndarray:
    """About a line 30 px off the principal point."""
    return np.stack([2 * 675.0 - uv[:, 0], uv[:, 1]], axis=-1)


def _changed(
    observations: Observations, which: np.ndarray, change: Change, names: list[str] | None = None
) -> Observations:
    views = tuple(
        replace(v, uv=change(v.uv) if w else v.uv, id=v.id if names is None else names[i], moment="")
        for i, (v, w) in enumerate(zip(observations.views, which, strict=True))
    )
    return replace(observations, views=views)


EVERY_SECOND = np.arange(VIEWS) % 2 == 1
SECOND_HALF = np.arange(VIEWS) >= VIEWS // 2
ANY = np.isin(np.arange(VIEWS), [0, 3, 4, 5, 9, 11, 14])


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_one_camera_is_one(seed: int) -> None:
    result = cb.calibrate_intrinsics(intrinsics_scene(VIEWS, seed=seed).observations)
    check = result.check("one-camera")
    assert check.status == "ok"
    assert "no group of the 16 views" in check.message


@pytest.mark.parametrize("change", [_scaled(1.02), _cropped, _mirrored], ids=["2 % larger", "cropped", "mirrored"])
@pytest.mark.parametrize("which", [EVERY_SECOND, SECOND_HALF], ids=["every second", "second half"])
def test_two_lenses_are_refused_and_named(which: np.ndarray, change: Change) -> None:
    data = _changed(intrinsics_scene(VIEWS, seed=5).observations, which, change)
    with pytest.raises(RefusedError, match=r"one-camera: two groups of views have lenses of their own") as caught:
        cb.calibrate_intrinsics(data)
    message = str(caught.value)
    names = [str(i) for i in np.flatnonzero(which)]
    assert f"{names[0]}, {names[1]} … {names[-1]} (8 views)" in message
    assert "calibrate them apart" in message


def _taller(uv: np.ndarray) -> np.ndarray:
    """Another mode of the sensor, scaled to the same size: 4 % higher."""
    return CENTRE + (uv - CENTRE) * [1.0, 1.04]


@pytest.mark.parametrize("which", [EVERY_SECOND, ANY], ids=["every second", "any"])
def test_views_stretched_in_height_are_named_with_both_focal_lengths(which: np.ndarray) -> None:
    data = _changed(intrinsics_scene(VIEWS, seed=5).observations, which, _taller)
    with pytest.raises(RefusedError, match=r"one-camera: two groups of views have lenses of their own") as caught:
        cb.calibrate_intrinsics(data)
    aspects = []
    for fx, fy in re.findall(r"fx ([0-9.]+) ± [^,]+, fy ([0-9.]+) ±", str(caught.value)):
        aspects.append(float(fy) / float(fx))
    assert max(aspects) / min(aspects) == pytest.approx(1.04, abs=0.005)


def test_every_second_is_told_by_its_number_where_views_are_missing() -> None:
    masks = [s.second.tolist() for s in named_splits([f"{i:02d}.png" for i in (1, 2, 3, 5, 6, 7, 8, 10)])]
    assert [True, False, True, True, False, True, False, False] in masks


@pytest.mark.parametrize("views", [3, 4, 5])
@pytest.mark.parametrize("seed", range(3))
def test_a_few_views_of_one_camera_are_in_peace(views: int, seed: int) -> None:
    check = cb.calibrate_intrinsics(intrinsics_scene(views, seed=seed).observations).check("one-camera")
    assert check.status == "ok"
    assert f"no parting of the {views} views" in check.message


@pytest.mark.parametrize("change", [_scaled(1.05), _cropped, _taller], ids=["5 % larger", "cropped", "taller"])
def test_two_lenses_in_five_views_are_named_and_held(change: Change) -> None:
    which = np.arange(5) % 2 == 1
    result = cb.calibrate_intrinsics(_changed(intrinsics_scene(5, seed=5).observations, which, change))
    check = result.check("one-camera")
    assert check.status == "warn"
    assert "0, 2, 4: fx" in check.message
    assert "1, 3: fx" in check.message
    assert "the uncertainties hold it" in check.message


def test_views_that_follow_no_order_are_found_where_the_difference_is_large() -> None:
    data = _changed(intrinsics_scene(VIEWS, seed=6).observations, ANY, _scaled(1.05))
    with pytest.raises(RefusedError, match=r"0, 3 … 14 \(7 views\)"):
        cb.calibrate_intrinsics(data)


def test_left_and_right_are_told_by_their_names() -> None:
    names = [f"{'right' if w else 'left'}{i:02d}.png" for i, w in enumerate(ANY)]
    data = _changed(intrinsics_scene(VIEWS, seed=7).observations, ANY, _cropped, names)
    with pytest.raises(RefusedError, match=r"right00.png, right03.png … .*left01.png, left02.png … "):
        cb.calibrate_intrinsics(data)


def test_the_figures_of_both_groups_are_what_each_alone_gives() -> None:
    data = _changed(intrinsics_scene(24, seed=8).observations, np.arange(24) >= 12, _scaled(1.01))
    with pytest.raises(RefusedError) as caught:
        cb.calibrate_intrinsics(data)
    said = [float(part.split(" ± ")[0]) for part in str(caught.value).split("fx ")[1:]]
    alone = [calibrate_keeping(replace(data, views=v)).result.camera for v in (data.views[:12], data.views[12:])]
    for fx, camera in zip(said, alone, strict=True):
        assert abs(fx - camera.parameters["fx"]) < 4 * camera.sigma["fx"]


def test_a_small_difference_is_held_by_the_uncertainty() -> None:
    """0.08 % of focal length: less than a milliradian at the image's border, many sigma all the same."""
    data = _changed(intrinsics_scene(60, seed=9, sigma_px=0.02).observations, np.arange(60) >= 30, _scaled(1.0008))
    result = cb.calibrate_intrinsics(data)
    check = result.check("one-camera")
    assert check.status == "warn"
    assert "the uncertainties hold it" in check.message
    alone = calibrate_keeping(data).result.camera.sigma["fx"]
    difference = 0.0008 * result.camera.parameters["fx"]
    assert result.camera.sigma["fx"] > 2 * alone
    assert result.camera.sigma["fx"] == pytest.approx(np.hypot(alone, difference / 2), rel=0.15)


def test_one_view_of_another_zoom_is_named() -> None:
    data = _changed(intrinsics_scene(VIEWS, seed=3).observations, np.arange(VIEWS) == 6, _scaled(1.05))
    check = cb.calibrate_intrinsics(data).check("one-camera")
    assert check.status == "warn"
    assert "6 alone sees another lens" in check.message
    assert "--exclude 6" in check.message


def test_series_are_told_by_what_stands_beside_the_numbers() -> None:
    names = ["a/left01.jpg", "a/left02.jpg", "a/left03.jpg", "a/right1.jpg", "a/right2.jpg", "a/right3.jpg"]
    masks = [split.second.tolist() for split in named_splits(names)]
    assert masks == [[False, True] * 3, [False] * 3 + [True] * 3]
    assert [s.second.tolist() for s in named_splits([f"{i}.png" for i in range(6)])] == [[False, True] * 3]


def test_the_stereo_photos(shared_data: Callable[[str], Path]) -> None:
    folder = shared_data("opencv_stereo_9x6")
    board = "chessboard:9x6:25mm"
    sides = {side: cb.detect(sorted(folder.glob(f"{side}*.jpg")), target=board) for side in ("left", "right")}
    for seen in sides.values():
        assert cb.calibrate_intrinsics(seen).check("one-camera").status == "ok"
    left = sides["left"]
    mixed = replace(left, views=(*left.views, *sides["right"].views))
    with pytest.raises(RefusedError, match=r"left01.jpg, left02.jpg … left14.jpg \(13 views\).*right01.jpg"):
        cb.calibrate_intrinsics(mixed)
    refocused = _changed(left, np.arange(13) < 6, lambda uv: [319.5, 239.5] + 1.02 * (uv - [319.5, 239.5]))
    check = cb.calibrate_intrinsics(refocused).check("one-camera")
    assert check.status == "warn"
    assert "left01.jpg, left02.jpg … left06.jpg (6 views)" in check.message
