"""Boards in the cell's pictures: where the camera's model has them, to a hundredth of a pixel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.simulate.robot_cell.cells import needs_opengl

from calibrant.cameras import Camera
from calibrant.detection.registry import detector_for
from calibrant.geometry import se3, so3
from calibrant.opencv import cv2
from calibrant.simulate.render import IDEAL, render
from calibrant.targets.registry import parse_target

from calibrant.simulate.robot_cell import RobotCell, RobotCellSpec, make_robot_cell, sheet  # isort: skip
from calibrant.simulate.robot_cell.parts.spec import LARGE_BOARD, WRIST  # isort: skip
from calibrant.simulate.robot_cell.pictures.lens import lens_map  # isort: skip
from calibrant.simulate.robot_cell.pictures.sheets import Eye, Sheet, draw_sheet  # isort: skip
from calibrant.simulate.robot_cell.world.light import Light  # isort: skip

CAMERA = Camera.create(
    "brown",
    {"fx": 610.0, "fy": 612.0, "cx": 322.0, "cy": 236.0, "k1": 0.08, "k2": -0.1, "p1": 5e-4, "p2": -4e-4},
    image_size=(640, 480),
)


def test_a_sheet_is_drawn_as_by_the_renderer_of_sheets() -> None:
    target = parse_target("charuco:6x5:40mm:31mm:DICT_5X5_1000")
    T = se3.make(so3.exp([0.3, -0.4, 0.6]), [-0.1, -0.1, 0.45])
    # The renderer has ink 25 and paper 215; here both are shares of the light.
    light = Light(np.array([0.0, 0.0, 1.0]), 215 / 255 / 0.92, 0.0)
    lens = lens_map(CAMERA)
    # Depth of the pinhole picture that holds the lens's.
    u, v = np.meshgrid(np.arange(lens.size[0]), np.arange(lens.size[1]))
    rays = np.stack([(u - lens.K[0, 2]) / lens.K[0, 0], (v - lens.K[1, 2]) / lens.K[1, 1], np.ones(u.shape)], axis=-1)
    n = T[:3, 2]
    depth = (float(n @ T[:3, 3]) / (rays @ n)).astype(np.float32)
    expected = render(
        target.artwork(), CAMERA, T, rng=np.random.default_rng(0), look=replace(IDEAL, ink_grey=0.10 / 0.92 * 215)
    )
    drawn = np.full((480, 640, 3), expected[0, 0], np.uint8)  # what is behind
    draw_sheet(drawn, depth, Sheet("board", target.artwork()), T, Eye(CAMERA, lens, np.eye(4), light))
    off = drawn[..., 0].astype(int) - expected
    # 16 points a pixel against 64: a few greys of 190 on edges, none elsewhere, and none on average.
    assert np.abs(off).max() < 30
    assert np.sqrt(np.mean(off.astype(float) ** 2)) < 2.0
    assert abs(off.mean()) < 0.15


def test_what_stands_before_a_sheet_hides_it() -> None:
    target = parse_target("charuco:6x5:40mm:31mm:DICT_5X5_1000")
    T = se3.make(np.eye(3), [-0.12, -0.1, 0.45])
    lens = lens_map(CAMERA)
    depth = np.full(lens.size[::-1], 0.45, np.float32)
    depth[:, lens.size[0] // 2 :] = 0.445
    drawn = np.full((480, 640, 3), 120, np.uint8)
    light = Light(np.array([0.0, 0.0, 1.0]), 1.0, 0.0)
    draw_sheet(drawn, depth, Sheet("board", target.artwork()), T, Eye(CAMERA, lens, np.eye(4), light))
    assert np.all(drawn[:, 330:] == 120)
    assert len(np.unique(drawn[200:300, 200:300])) > 2


def _corner_errors(cell: RobotCell, name: str, T_camera_board: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Detected less true (n, 2), px, and the detector's own sigma (n,)."""
    target = parse_target(LARGE_BOARD)
    cell.place("board", cell.truth.T_base_camera(name) @ T_camera_board)
    picture = cell.camera(name).take_colour()
    found = detector_for("charuco").detect(cv2.cvtColor(picture.colour, cv2.COLOR_BGR2GRAY), target)  # type: ignore[arg-type]
    assert found.found
    p = target.points[found.point_ids]
    true = cell.truth.camera(name).project(se3.apply(cell.truth.T_camera_object(name, "board"), p))
    assert found.sigma_px is not None
    return found.uv - true, found.sigma_px


@needs_opengl()
@pytest.mark.parametrize("tilt", [0.0, 0.5])
def test_corners_are_found_where_they_are(tilt: float) -> None:
    spec = RobotCellSpec(objects=(sheet("board", LARGE_BOARD),), cameras=(WRIST,))
    middle = parse_target(LARGE_BOARD).points.mean(axis=0)
    with make_robot_cell(5, spec=spec) as cell:
        R = so3.exp([tilt, 0.3 * tilt, 0.2])
        off, sigma = _corner_errors(cell, "wrist", se3.make(R, np.array([0, 0, 0.5]) - R @ middle))
    assert len(off) > 30
    # The mean over so many corners scatters by a few thousandths of a pixel.
    assert np.abs(off.mean(axis=0)).max() < 0.02
    assert np.sqrt(np.mean(off**2)) < 0.05
    # As the detector says, to a factor: its sigma is from the residuals of each corner's own fit.
    assert 0.3 < np.sqrt(np.mean((off / sigma[:, None]) ** 2)) < 3.0
