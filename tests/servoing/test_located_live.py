"""The dynamic method live: sigma falls with every picture, a moved camera is seen, and the guidance leads there."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
from tests.servoing.cells import BOARD, CAMERA, HAND, READY

from calibrant.calibrate.dynamic.problem import WristCamera
from calibrant.calibrate.dynamic.track import DynamicCalibration, DynamicNoise
from calibrant.cameras import Camera
from calibrant.data import Picture
from calibrant.detection.detection import Detection
from calibrant.geometry import se3, so3
from calibrant.robots.arms import arm
from calibrant.servoing.located_live import EXTERNAL, WRIST, located_live
from calibrant.servoing.sight.eye import Model
from calibrant.simulate.point_cell import KinematicArm, PointCamera
from calibrant.simulate.truth import chi_square

LENS = Camera(CAMERA.model, CAMERA.image_size, CAMERA.values, np.diag([0.25, 0.25, 0.25, 0.25]))


class Setting:
    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.robot = KinematicArm(arm("ur5e"), READY)
        tilt = so3.exp([0.3, 0.1, 0.0])
        board = self.robot.pose() @ HAND @ se3.make(tilt, np.array([0, 0, 0.4]) - tilt @ BOARD.mean(axis=0))
        middle = se3.apply(board, BOARD.mean(axis=0))
        R = board[:3, :3] @ so3.exp([0.2, -0.3, 0.4])
        self.place = se3.make(R, middle - R @ np.array([0.0, 0.0, 0.7]))
        self.wrist = PointCamera(
            self.robot, CAMERA, BOARD, lambda: self.robot.chain.forward(self.robot.q) @ HAND, lambda t: board, rng
        )
        self.external = PointCamera(
            self.robot, CAMERA, BOARD, lambda: self.place, lambda t: board, rng, name="external"
        )
        C = np.zeros((10, 10))
        C[:3, :3], C[3:6, 3:6] = 1e-3**2 * np.eye(3), 5e-4**2 * np.eye(3)
        C[6:, 6:] = LENS.covariance
        self.known = DynamicCalibration(WristCamera(LENS, HAND, C), LENS, DynamicNoise(0.1, 0.1, 1e-4, 1e-4))

    def find(self, picture: Picture) -> Detection:
        source = self.wrist if picture.name.startswith("wrist") else self.external
        uv = source.pixels(picture)
        if uv is None:
            return Detection.nothing("no board in the picture")
        return Detection(np.arange(len(uv)), uv)

    def live(self, wanted: np.ndarray | None = None):
        model = Model(np.arange(len(BOARD)), BOARD)
        return located_live(self.robot, self.wrist, self.external, self.known, self.find, model, wanted=wanted)


def test_every_picture_tells_place_and_sigma() -> None:
    setting = Setting(0)
    run = setting.live()
    first, second = islice(run, 2)
    assert (first.camera, second.camera) == (WRIST, EXTERNAL)
    assert first.T_base_external is None
    assert "not seen" in first.words
    sigma = [second.sigma_mm]
    for joint in (1, 2, 3):
        setting.robot.q = READY + 0.06 * np.eye(6)[joint]
        last = list(islice(run, 2))[-1]
        sigma.append(last.sigma_mm)
    assert sigma[-1] < sigma[0]
    estimate = last.T_base_external
    assert estimate is not None
    off = se3.local(setting.place, estimate.matrix)
    assert chi_square(off, estimate.covariance) < 22.5  # 6 degrees of freedom, 99.9 %
    assert f"known to {last.sigma_mm:.2g} mm" in last.words


def test_a_person_who_follows_the_words_arrives() -> None:
    setting = Setting(1)
    wanted = setting.place @ se3.make(so3.exp([0.0, 0.02, 0.05]), [-0.02, 0.015, 0.0])
    run = setting.live(wanted)
    last = list(islice(run, 2))[-1]
    assert last.to_go is not None
    assert "to the left" in last.words
    assert "clockwise" in last.words
    setting.place = setting.place @ se3.make(so3.exp(np.deg2rad(last.to_go.deg)), 1e-3 * last.to_go.mm)
    last = next(run)
    assert last.moved
    mm, deg = se3.deviation(wanted, setting.place)
    assert mm < 4 * last.sigma_mm
    assert deg < 4 * last.sigma_deg
    assert last.to_go is not None
    assert np.linalg.norm(last.to_go.mm) < 6 * last.sigma_mm


def test_a_picture_without_the_target_changes_nothing_and_says_so() -> None:
    setting = Setting(2)
    run = setting.live()
    before = list(islice(run, 2))[-1]
    setting.place = setting.place @ se3.make(np.eye(3), [3.0, 0.0, 0.0])
    after = next(run)
    assert "no board" in after.words
    assert after.known is before.known


def test_pictures_that_agree_are_not_called_moved() -> None:
    setting = Setting(3)
    assert not any(found.moved for found in islice(setting.live(), 12))


@pytest.mark.statistics
def test_false_moves_are_rare() -> None:
    moved = sum(found.moved for seed in range(20) for found in islice(Setting(seed).live(), 11))
    assert moved <= 2  # of 200, at a chance of 1e-4 each
