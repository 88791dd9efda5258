"""A board of which a part is hidden, numbered where another camera says that its corners are."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.detection.chessboard.detector import ChessboardDetector
from calibrant.detection.chessboard.second_look import part_there
from calibrant.geometry import se3, so3
from calibrant.opencv import cv2
from calibrant.simulate.render import render
from calibrant.simulate.scenes import standard_camera
from calibrant.targets.chessboard import Chessboard
from calibrant.targets.registry import parse_target

CAMERA = standard_camera()


@pytest.mark.parametrize(
    ("spec", "turn_deg"), [("chessboard:9x6:25mm", 0.0), ("chessboard:9x6:25mm", 200.0), ("chessboard:8x6:25mm", 100.0)]
)
def test_a_hidden_board_is_numbered_where_it_is_expected(spec: str, turn_deg: float) -> None:
    """A hand over a third of the board: its end is not seen, and which corners remain only the other camera knows."""
    target, rng = parse_target(spec), np.random.default_rng(1)
    assert isinstance(target, Chessboard)
    R = so3.exp([0.3, 0.2, 0.0]) @ so3.exp([0.0, 0.0, np.deg2rad(turn_deg)])
    T = se3.make(R, np.array([0.0, 0.0, 0.45]) - R @ target.points.mean(axis=0))
    true = CAMERA.project(se3.apply(T, target.points))
    picture = render(target.artwork(), CAMERA, T, rng=rng)
    hidden = target.point_ids % target.columns < 3
    hull = cv2.convexHull(true[hidden].astype(np.float32)).reshape(-1, 2)
    hull = hull.mean(axis=0) + 1.7 * (hull - hull.mean(axis=0))
    cv2.fillConvexPoly(picture, np.rint(hull).astype(np.int32), 120)
    assert not ChessboardDetector().detect(picture, target).found
    square = np.linalg.norm(true[1] - true[0])
    expected = true + 0.15 * square  # the other camera and its place err by a few pixels
    found = part_there(picture, target, np.stack([np.full_like(true, np.nan), expected]))
    assert found is not None
    assert len(found.uv) >= 12
    assert np.abs(found.uv - true[found.point_ids]).max() < 0.3
    elsewhere = true + np.array([0.0, 2.5 * square])
    there = part_there(picture, target, elsewhere[None])
    assert there is None or np.linalg.norm(there.uv - true[there.point_ids], axis=1).min() > square
    assert part_there(np.full_like(picture, 128), target, expected[None]) is None
