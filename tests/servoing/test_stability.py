"""The predicted margin: 1 of a perfect calibration, and the loop converges or not as it says."""

from __future__ import annotations

import numpy as np
from tests.servoing.cells import CAMERA, make_cell

from calibrant.cameras import Camera
from calibrant.errors import CalibrantError
from calibrant.servoing.laws.registry import LAWS
from calibrant.servoing.loop import ServoOptions, servo
from calibrant.servoing.sight.mounting import Mounting
from calibrant.servoing.stability import loop_eigenvalues, margin_of, turned


def test_a_perfect_calibration_converges_alike_in_all_directions() -> None:
    cell = make_cell(0, sigma_px=0.01)
    wanted = cell.taught(cell.eye(), pictures=2)
    np.testing.assert_allclose(loop_eigenvalues(wanted, cell.mounting, cell.T_wanted), 1.0, atol=1e-9)


def test_the_margin_falls_with_sigma_and_with_errors() -> None:
    cell = make_cell(0, sigma_px=0.01)
    wanted = cell.taught(cell.eye(), pictures=2)
    k = len(CAMERA.values)
    unsure = Camera(
        CAMERA.model, CAMERA.image_size, CAMERA.values, np.diag(np.r_[np.full(2, 60.0**2), np.zeros(k - 2)])
    )
    loose = Mounting(cell.mounting.setup, cell.mounting.transform, np.diag(np.r_[np.full(3, 0.1**2), np.full(3, 1e-4)]))
    sure, open_ = (margin_of(wanted, c, m, cell.T_wanted) for c, m in ((CAMERA, cell.mounting), (unsure, loose)))
    assert sure.at_sigma == sure.margin
    assert open_.at_sigma < 0.95 * open_.margin
    assert sure.focal_low < 0.7
    assert sure.focal_high > 1.5
    assert 45 < sure.hand_eye_deg < 120


def test_the_loop_goes_wrong_where_the_margin_is_gone() -> None:
    axis = np.array([0.0, 0.0, 1.0])
    for degrees, arrives in ((40.0, True), (140.0, False)):
        cell = make_cell(1, sigma_px=0.02)
        eye = cell.eye(mounting=turned(cell.mounting, degrees, axis))
        wanted = cell.taught(eye, pictures=5)
        hand_eye = np.r_[np.deg2rad(degrees) * cell.mounting.transform[:3, 2], 0, 0, 0]
        stable = loop_eigenvalues(wanted, cell.mounting, cell.T_wanted, hand_eye=hand_eye).real.min() > 0
        assert stable == arrives
        cell.start(np.random.default_rng(1), metres=0.03, degrees=3)
        try:
            servo(cell.robot, eye, wanted, LAWS["image"], options=ServoOptions(stall_s=2.0))
            arrived = cell.off()[0] < 0.3
        except CalibrantError:
            arrived = False
        assert arrived == arrives
