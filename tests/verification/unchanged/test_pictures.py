"""Pictures beside a reference: which way it moved, what moved in it, what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.simulate.background import clutter
from calibrant.simulate.wall import photograph_wall, wall
from calibrant.verification.unchanged.answer import ANY_CHANGE, answer_of_picture
from calibrant.verification.unchanged.consensus import Motion, motion
from calibrant.verification.unchanged.pictures import Reference, became, kept_reference, record_of

CAMERA = Camera.create("pinhole", {"fx": 500.0, "fy": 500.0, "cx": 239.5, "cy": 179.5}, image_size=(480, 360))


def photos(px: tuple[float, float], *, seed: int = 0, box: bool = True) -> tuple[Reference, Reference]:
    """Then and now of a camera that was turned so that its picture moves by px, a box in it moved by itself."""
    rng = np.random.default_rng(seed)
    scene = wall(CAMERA, rng=rng)
    drawing = clutter((110, 90), shapes=12, rng=rng)
    R = so3.exp(np.array([px[1], -px[0], 0.0]) / 500)
    boxes = [(30, 40, drawing), (300, 210, drawing)] if box else [None, None]
    pictures = (
        photograph_wall(scene, CAMERA, T, rng=rng, box=b)
        for T, b in zip((np.eye(4), se3.make(R, np.zeros(3))), boxes, strict=True)
    )
    return tuple(Reference(n, p, CAMERA.image_size) for n, p in zip(("then", "now"), pictures))  # type: ignore[return-value]


@pytest.mark.parametrize(("px", "words"), [((5.0, 0.0), "px to the right"), ((-3.0, -4.0), "px to the left and up")])
def test_a_push_is_told_with_its_direction_in_another_light(px: tuple[float, float], words: str) -> None:
    moved = became(*photos(px))
    assert moved.shift == pytest.approx(px, abs=0.5)
    answer = answer_of_picture([moved], CAMERA, 1.0, ANY_CHANGE)
    assert answer is not None
    assert answer.changed
    assert words in answer.words
    assert answer.figures["at the workpiece"][0] == pytest.approx(10, abs=1)  # 5 px at 1 m and 500 px


def test_a_picture_that_stands_is_unchanged_whatever_moves_in_it() -> None:
    moved = became(*photos((0.0, 0.0), seed=1))
    answer = answer_of_picture([moved], CAMERA, None, ANY_CHANGE)
    assert answer is not None
    assert not answer.changed
    assert "the picture is where it was" in answer.words
    then, now = moved.otherwise
    assert len(then)
    assert np.median(now - then, axis=0) == pytest.approx([270, 170], abs=3)


def test_the_camera_is_told_to_have_turned_the_other_way() -> None:
    answer = answer_of_picture([became(*photos((8.0, 0.0), box=False))], CAMERA, None, ANY_CHANGE)
    assert answer is not None
    assert "The camera was turned 0.92 deg to the left" in answer.advice
    assert "px left" in answer.advice


def test_a_kept_copy_serves_as_the_photo() -> None:
    then, now = photos((5.0, 0.0), seed=2)
    kept = kept_reference(record_of(then))
    assert kept.image_size == then.image_size
    assert became(kept, now).shift == pytest.approx([5, 0], abs=0.5)


def blank(seed: int) -> Reference:
    grey = np.random.default_rng(seed).integers(120, 124, (360, 480)).astype(np.uint8)
    return Reference("blank", grey, (480, 360))


def test_scenes_without_texture_and_other_scenes_are_refused() -> None:
    then, _ = photos((0.0, 0.0))
    with pytest.raises(InputError, match="too little texture"):
        became(blank(0), blank(1))
    with pytest.raises(InputError, match=r"are found again|agree on no motion"):
        became(then, photos((0.0, 0.0), seed=9)[0])
    with pytest.raises(InputError, match="another camera, or one of them was cropped"):
        became(then, Reference("crop", then.grey[:200], (480, 200)))


def two_halves(shift: float) -> Motion:
    rng = np.random.default_rng(0)
    then = rng.uniform((0, 0), (640, 480), (300, 2))
    now = then + np.where(then[:, :1] < 320, 0.0, shift) + 0.1 * rng.standard_normal((300, 2))
    return motion(then, now, (640, 480))


def test_two_halves_that_moved_differently_are_refused() -> None:
    with pytest.raises(InputError, match="two parts of the picture moved differently"):
        two_halves(60.0)
    assert np.linalg.norm(two_halves(0.0).shift) < 0.1


def test_the_shift_lies_within_its_sigma() -> None:
    square = 0.0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        then = rng.uniform((0, 0), (640, 480), (150, 2))
        moved = motion(then, then + [2.0, -1.0] + 0.3 * rng.standard_normal((150, 2)), (640, 480))
        step = moved.shift - [2.0, -1.0]
        square += float(step @ np.linalg.solve(moved.covariance[:2, :2], step)) / 2
    assert 0.5 < square / 12 < 1.7
