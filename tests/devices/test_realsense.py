"""A RealSense against a fake of pyrealsense2's documented interface. Nothing here was run on hardware."""

from __future__ import annotations

import numpy as np
import pytest
from tests.devices.fake_clock import patched_clock
from tests.devices.fake_realsense import Camera, Distortion, Domain, T_colour_depth, installed

from calibrant.devices import open_devices
from calibrant.errors import DeviceError, InputError


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> Camera:
    patched_clock(monkeypatch)
    return installed(monkeypatch)


def test_aligned_depth_has_the_colours_grid(fake: Camera) -> None:
    with open_devices(camera="realsense:123456,size=1280x720,depth-size=848x480") as devices:
        picture = devices.camera.take()
        stated = devices.camera.stated
    assert fake.serial == "123456"
    assert picture.size == (1280, 720)
    assert picture.depth is not None
    assert picture.depth.shape == (720, 1280)
    assert picture.depth.dtype == np.float32
    assert stated.colour is not None
    assert stated.colour.model.name == "pinhole"
    assert stated.colour.parameters == {"fx": 615.0, "fy": 616.0, "cx": 321.0, "cy": 239.0}
    assert stated.depth is stated.colour
    assert np.array_equal(stated.T_colour_depth, np.eye(4))
    assert fake.stopped == 1


def test_own_depth_keeps_its_grid_and_says_where_its_camera_is(fake: Camera) -> None:
    with open_devices(camera="realsense:size=640x480,depth=own,depth-size=848x480") as devices:
        picture, stated = devices.camera.take(), devices.camera.stated
    assert picture.depth is not None
    assert picture.depth.shape == (480, 848)
    assert np.isnan(picture.depth[0, 0])
    assert picture.depth[1, 1] == np.float32(0.8)
    assert stated.depth is not None
    assert stated.depth.image_size == (848, 480)
    assert np.allclose(stated.T_colour_depth, T_colour_depth, atol=1e-12)


def test_without_depth(fake: Camera) -> None:
    with open_devices(camera="realsense:depth=none") as devices:
        assert devices.camera.take().depth is None
        assert devices.camera.stated.depth is None
    with pytest.raises(InputError, match="aligned or own or none"):
        open_devices(camera="realsense:depth=some")


def test_lens_is_stated_where_a_model_here_has_its_distortion(fake: Camera) -> None:
    fake.coeffs = [0.1, -0.2, 0.001, 0.002, 0.05]
    assert open_devices(camera="realsense").camera.stated.colour is None
    fake.model = Distortion.brown_conrady
    lens = open_devices(camera="realsense").camera.stated.colour
    assert lens is not None
    assert [lens.parameters[k] for k in ("k1", "k2", "p1", "p2", "k3")] == fake.coeffs


def test_time_is_the_exposures_where_the_clocks_are_tied(fake: Camera) -> None:
    camera = open_devices(camera="realsense").camera
    assert camera.take().time_s == pytest.approx(1.7e9 + 0.033 * fake.number, abs=1e-6)
    fake.domain = Domain.hardware_clock
    assert camera.take().time_s == 1_700_000_000.0


def test_picture_of_before_is_dropped(fake: Camera) -> None:
    camera = open_devices(camera="realsense").camera
    fake.queued, before = 1, fake.number
    assert int(camera.take().colour[0, 0, 0]) == before + 2


def test_unplugged_camera_is_said(fake: Camera) -> None:
    camera = open_devices(camera="realsense").camera
    camera.take()
    fake.there = False
    with pytest.raises(DeviceError, match="unplugged"):
        camera.take()
    camera.close()
    camera.close()
    assert fake.stopped == 1
    with pytest.raises(DeviceError, match="closed"):
        camera.take()
    with pytest.raises(DeviceError, match="No device connected"):
        open_devices(camera="realsense")
