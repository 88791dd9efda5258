"""A box on a belt by its outline: exact in a drawn picture, and what is no box is said to be none."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from tests.servoing.cells import CAMERA

from calibrant.data import Picture
from calibrant.geometry import se3, so3
from calibrant.perceive.colour.ranges import ColourRange
from calibrant.servoing.conveyor.box_outline import BoxOutline

RED = ColourRange.parse("h:340-20 s:45-100 v:15-100")
HEIGHT, SIZE = 0.02, (0.05, 0.04, 0.03)
T_BASE_CAMERA = se3.make(so3.exp([np.pi, 0, 0]) @ so3.exp([0.05, -0.08, 0.4]), [0.5, 0.1, 0.35])


def drawn(T_base_box: np.ndarray, corners: np.ndarray | None = None) -> Picture:
    """The box in red on grey, its rim sharp to a sixteenth of a pixel."""
    if corners is None:
        corners = 0.5 * np.array(SIZE) * np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    uv = CAMERA.project(se3.apply(se3.inverse(T_BASE_CAMERA) @ T_base_box, corners))
    colour = np.full((480, 640, 3), 90, np.uint8)
    hull = cv2.convexHull(uv.astype(np.float32))
    cv2.fillConvexPoly(colour, np.rint(hull * 16).astype(np.int32), (20, 20, 190), shift=4)
    return Picture("0", colour, 0.0)


@pytest.mark.parametrize(("x", "y", "turn"), [(0.5, 0.1, 0.0), (0.53, 0.06, 0.7), (0.45, 0.13, -1.2)])
def test_place_and_turn_are_found(x: float, y: float, turn: float) -> None:
    truth = se3.make(so3.exp([0, 0, turn]), [x, y, HEIGHT + SIZE[2] / 2])
    found = BoxOutline(CAMERA, RED, SIZE, HEIGHT)(drawn(truth), T_BASE_CAMERA)
    assert not isinstance(found, str), found
    T = T_BASE_CAMERA @ found.T_camera_object
    assert np.abs(T[:3, 3] - truth[:3, 3]).max() < 3e-4
    off = float(so3.log(truth[:3, :3].T @ T[:3, :3])[2])
    assert abs((off + np.pi / 2) % np.pi - np.pi / 2) < 0.01
    R = np.zeros((6, 6))
    R[:3, :3] = R[3:, 3:] = T_BASE_CAMERA[:3, :3]
    sigma = np.sqrt(np.diag(R @ found.covariance @ R.T))
    assert np.all(np.abs(T[:2, 3] - truth[:2, 3]) < 4 * sigma[3:5])
    assert sigma[3:5].max() < 1e-3


def test_what_is_no_such_box_is_said_to_be_none() -> None:
    sight = BoxOutline(CAMERA, RED, SIZE, HEIGHT)
    grey = Picture("1", np.full((480, 640, 3), 90, np.uint8), 0.0)
    assert "colour" in str(sight(grey, T_BASE_CAMERA))
    at = se3.make(np.eye(3), [0.5, 0.1, HEIGHT + SIZE[2] / 2])
    stick = np.array([[-0.06, -0.01, 0], [0.06, -0.01, 0], [0.06, 0.01, 0], [-0.06, 0.01, 0]])
    assert "outline" in str(sight(drawn(at, stick), T_BASE_CAMERA))
    border = se3.make(np.eye(3), [0.68, 0.1, HEIGHT + SIZE[2] / 2])
    assert "border" in str(sight(drawn(border), T_BASE_CAMERA))
