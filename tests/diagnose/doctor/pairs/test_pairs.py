"""Pictures of two cameras with one thing wrong: it is named, with how sure that is, and the repair undoes it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calibrant.cameras import Camera
from calibrant.data import Observations, View
from calibrant.data.details import Faults
from calibrant.diagnose.doctor.pairs.case import lens_of
from calibrant.diagnose.doctor.pairs.diagnosis import PairDiagnosis, as_result, diagnose_pairs
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import look_at_board
from calibrant.targets.registry import parse_target

BOARD = parse_target("chessboard:9x6:25mm").points
SIZE = (640, 480)
LENS = {"fx": 530.0, "fy": 528.0, "cx": 322.0, "cy": 238.0, "k1": -0.2, "k2": 0.08}
LEFT = Camera.create("brown", LENS, image_size=SIZE)
RIGHT = Camera.create("brown", {**LENS, "fx": 545.0, "fy": 546.0, "cx": 315.0}, image_size=SIZE)
T_LEFT_RIGHT = se3.make(so3.exp([0.02, -0.06, 0.01]), [0.12, 0.004, 0.01])
COUNT = 9


def seen(camera: Camera, name: str, T: np.ndarray, moment: str, rng: np.random.Generator) -> View:
    uv = camera.project(se3.apply(T, BOARD)) + rng.normal(0, 0.1, (len(BOARD), 2))
    return View(f"{name}{moment}", BOARD, uv, np.arange(len(BOARD)), name, moment)


@cache
def poses() -> np.ndarray:
    return np.stack(look_at_board(LEFT, BOARD, COUNT, rng=np.random.default_rng(3), distance=(0.5, 0.8), tilt_deg=35))


def pair(*, zoomed: tuple[int, ...] = (), moved_from: int = COUNT) -> Observations:
    """The pair's views; zoomed: right pictures by another camera; moved_from: from where the right camera stands 10 mm
    elsewhere."""
    rng, views = np.random.default_rng(1), []
    other = Camera.create("brown", {**LENS, "fx": 700.0, "fy": 700.0}, image_size=SIZE)
    for k, T in enumerate(poses()):
        at = T_LEFT_RIGHT if k < moved_from else T_LEFT_RIGHT @ se3.make(np.eye(3), [0.0, 0.01, 0.0])
        views.append(seen(LEFT, "left", T, f"{k:02d}", rng))
        views.append(seen(other if k in zoomed else RIGHT, "right", se3.inverse(at) @ T, f"{k:02d}", rng))
    return Observations(tuple(views), {"left": SIZE, "right": SIZE}, "chessboard:9x6:25mm")


def with_moments(given: Observations, moment: Callable[[int], int | None]) -> Observations:
    """The right views as of other moments; None leaves a view out."""
    out = []
    for v in given.views:
        if v.camera == "right":
            new = moment(int(v.moment))
            if new is None:
                continue
            v = replace(v, moment=f"{new:02d}")
        out.append(v)
    return replace(given, views=tuple(out))


def exchanged(given: Observations, moments: tuple[int, ...]) -> Observations:
    other = {"left": "right", "right": "left"}
    swap = [replace(v, camera=other[v.camera]) if int(v.moment) in moments else v for v in given.views]
    return replace(given, views=tuple(swap))


def mirrored(given: Observations, name: str) -> Observations:
    """As a detector numbers the board in mirror images."""
    middle = BOARD.mean(axis=0)
    points = BOARD.copy()
    points[:, 0] = 2 * middle[0] - points[:, 0]
    order = [int(np.argmin(np.sum((BOARD - p) ** 2, axis=1))) for p in points]
    flip = [
        replace(v, uv=np.column_stack([SIZE[0] - 1 - v.uv[:, 0], v.uv[:, 1]])[order]) if v.camera == name else v
        for v in given.views
    ]
    return replace(given, views=tuple(flip))


def only(found: PairDiagnosis) -> str:
    assert len(found.findings) == 1, [f.text for f in found.findings]
    assert found.findings[0].confidence > 0.999
    return found.findings[0].name


def sound(found: PairDiagnosis) -> bool:
    """Whether the repaired pairs agree, to the noise of single views."""
    return not found.repaired.wrong.any() and found.repaired.loop.mm < 3


def test_pairs_that_belong_together_raise_no_alarm() -> None:
    found = diagnose_pairs(pair())
    assert found.findings == ()
    assert as_result(found).verdict == "ok"


@pytest.mark.parametrize(
    ("moment", "words"),
    [
        (lambda k: k - 1 if k else None, "right's pictures come one place too early"),
        pytest.param(
            lambda k: k + 2 if k + 2 < COUNT else None,
            "right's pictures come 2 places too late",
            marks=pytest.mark.long,
        ),
        (
            lambda k: k if k < 4 else (None if k == 4 else k - 1),
            "from right05 on right's pictures come one place too early",
        ),
        pytest.param(lambda k: COUNT - 1 - k, "right's pictures are listed backwards", marks=pytest.mark.long),
    ],
)
def test_lists_out_of_step_are_named_and_put_in_step(moment: Callable[[int], int | None], words: str) -> None:
    found = diagnose_pairs(with_moments(pair(), moment))
    assert only(found) in ("pairs-shifted", "pairs-backwards")
    assert words in found.findings[0].message
    assert sound(found)
    assert found.given.loop.mm > 20


@pytest.mark.long
def test_two_pictures_in_each_others_place_are_named() -> None:
    swap = {3: 6, 6: 3}
    found = diagnose_pairs(with_moments(pair(), lambda k: swap.get(k, k)))
    assert only(found) == "pairs-exchanged"
    assert set(found.findings[0].views) == {"right03", "right06"}
    assert sound(found)


@pytest.mark.long
def test_cameras_exchanged_in_some_pairs_are_named() -> None:
    found = diagnose_pairs(exchanged(pair(), (2, 5)))
    assert only(found) == "cameras-exchanged"
    assert "2 of 9 pairs" in found.findings[0].message
    assert sound(found)


@pytest.mark.long
def test_swapped_sides_are_named_with_where_the_right_camera_stands() -> None:
    found = diagnose_pairs(exchanged(pair(), tuple(range(COUNT))))
    assert only(found) == "sides-swapped"
    measured = found.findings[0].measured
    assert measured is not None
    assert measured.value == pytest.approx(-120, abs=4)
    assert sound(found)


@pytest.mark.parametrize("name", [pytest.param("left", marks=pytest.mark.long), "right"])
def test_a_camera_that_mirrors_is_named_with_its_option(name: str) -> None:
    found = diagnose_pairs(mirrored(pair(), name))
    assert only(found) == "camera-mirrored"
    assert f"--mirror-{name}" in found.findings[0].proposal
    assert sound(found)


@pytest.mark.long
def test_a_picture_of_another_camera_is_named_with_its_focal_length() -> None:
    found = diagnose_pairs(pair(zoomed=(4,)))
    assert only(found) == "picture-of-another-camera"
    measured = found.findings[0].measured
    assert measured is not None
    assert measured.value == pytest.approx(700 / 545, abs=5 * measured.sigma + 0.02)
    assert found.findings[0].views == ("right04",)
    assert sound(found)


@pytest.mark.long
def test_cameras_that_moved_are_named_with_when() -> None:
    found = diagnose_pairs(pair(moved_from=4))
    assert only(found) == "cameras-moved"
    assert "between left03 and left04" in found.findings[0].message
    assert len(found.repaired) == COUNT - 4


@pytest.mark.long
def test_two_faults_are_both_named() -> None:
    found = diagnose_pairs(exchanged(pair(zoomed=(1,)), (5,)))
    assert {f.name for f in found.findings} == {"picture-of-another-camera", "cameras-exchanged"}
    assert sound(found)


@pytest.mark.long
def test_the_result_holds_the_findings_and_every_pair() -> None:
    result = as_result(diagnose_pairs(exchanged(pair(), (2,))))
    assert result.kind == "doctor"
    assert result.verdict == "refused"
    faults = result.detail(Faults)
    assert faults is not None
    before, after = faults.found[0].loop_before, faults.found[0].loop_after
    assert before is not None
    assert after is not None
    assert before.mm > 10 * after.mm
    assert set(result.figures) >= {"loop_before_mm", "loop_after_mm"}


def test_what_is_no_pair_is_said() -> None:
    with pytest.raises(InputError, match="a pair has two cameras"):
        diagnose_pairs(pair().of_camera("left"))
    few = with_moments(pair(), lambda k: k if k < 2 else k + 50)
    with pytest.raises(RefusedError, match="saw the board together in 2 pictures"):
        diagnose_pairs(few)
    assert lens_of(pair(), "left").camera.parameters["fx"] == pytest.approx(530, abs=5)
