"""Gripper features in pictures: found to a part of a pixel, and what their shifts say of the camera."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.verification.watch.dots import DotsThen, camera_move, dot_sights, find_dots
from calibrant.verification.watch.sequential import Rule, watch

CAMERA = Camera.create("pinhole", {"fx": 600.0, "fy": 600.0, "cx": 319.5, "cy": 239.5}, image_size=(640, 480))
T_GRIPPER_CAMERA = se3.make(so3.exp([-0.6, 0.0, 0.0]), [0.0, -0.08, -0.02])
DOTS = np.array([[-0.03, 0.02, 0.12], [0.03, 0.02, 0.12], [-0.03, 0.05, 0.09], [0.03, 0.05, 0.14]])


def seen(D: Array) -> Array:
    return CAMERA.project(se3.apply(se3.inverse(T_GRIPPER_CAMERA @ D), DOTS))


def picture(uv: Array, rng: np.random.Generator) -> Array:
    """Dark dots of 5 px on grey, as light falls on pixels: 8 times finer, then averaged."""
    grey = np.full((480 * 8, 640 * 8), 170, np.uint8)
    for u, v in uv:
        cv2.circle(grey, (round((u + 0.5) * 8 - 0.5), round((v + 0.5) * 8 - 0.5)), 40, 30, -1)
    return cv2.resize(grey, (640, 480), interpolation=cv2.INTER_AREA) + rng.normal(scale=2, size=(480, 640))


def test_dots_are_found_where_they_are() -> None:
    rng, uv = np.random.default_rng(0), seen(np.eye(4))
    uv = np.round(uv * 8) / 8
    found = find_dots(picture(uv, rng), np.add(uv, (3.0, -2.0)))
    assert found == pytest.approx(uv, abs=0.1)


def test_a_dot_that_is_hidden_is_not_there() -> None:
    uv = seen(np.eye(4))
    found = find_dots(picture(uv[1:], np.random.default_rng(0)), uv)
    assert np.isnan(found[0]).all()
    assert np.isfinite(found[1:]).all()
    with pytest.raises(InputError, match="feature 1 is not near"):
        dot_sights(["0"], found[None], DotsThen(uv, DOTS, 0.1))


def test_shifts_of_four_dots_give_the_move() -> None:
    D = se3.retract(np.eye(4), [1e-4, -2e-4, 3e-4, 2e-4, -1e-4, 3e-4])
    then = DotsThen(seen(np.eye(4)), DOTS, 0.1)
    shift = (seen(D) - then.uv).ravel()
    found = camera_move(CAMERA, T_GRIPPER_CAMERA, then, shift, 0.01 * np.eye(8))
    assert found is not None
    assert found[0] == pytest.approx(se3.local(np.eye(4), D), abs=5e-6)  # of second order, some 1e-3 of the move


def test_two_dots_tell_no_move_but_when() -> None:
    rng = np.random.default_rng(1)
    then = DotsThen(seen(np.eye(4))[:2] + rng.normal(scale=0.1, size=(2, 2)), DOTS[:2], 0.1)
    pushed = seen(se3.make(np.eye(3), [0.001, 0.0, 0.0]))[:2]
    found = np.stack(
        [(seen(np.eye(4))[:2] if i < 12 else pushed) + rng.normal(scale=0.1, size=(2, 2)) for i in range(30)]
    )
    state = watch(dot_sights([str(i) for i in range(30)], found, then), Rule())
    assert state.alarm is not None
    assert state.alarm.since in (11, 12)
    assert state.alarm.at <= 21
    assert camera_move(CAMERA, T_GRIPPER_CAMERA, then, np.zeros(4), np.eye(4)) is None
