"""OpenCV's cameras: a fake of a running one, and a video file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.devices.fake_clock import FakeClock, patched_clock
from tests.devices.fake_opencv import FakeCapture

from calibrant.devices import open_devices, opencv_camera
from calibrant.errors import DeviceError, InputError
from calibrant.opencv import cv2


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> FakeClock:
    return patched_clock(monkeypatch)


def opened(monkeypatch: pytest.MonkeyPatch, capture: FakeCapture, spec: str = "opencv:0"):
    monkeypatch.setattr(opencv_camera, "open_capture", lambda source: capture)
    return open_devices(camera=spec)


def test_pictures_of_before_are_dropped(monkeypatch: pytest.MonkeyPatch, clock: FakeClock) -> None:
    capture = FakeCapture(clock, queued=4)
    camera = opened(monkeypatch, capture).camera
    first = camera.take()
    assert int(first.colour[0, 0, 0]) == 5
    assert first.time_s == clock.now
    capture.queued = 3
    assert int(camera.take().colour[0, 0, 0]) == 9


def test_camera_that_never_waits_gives_pictures_still(monkeypatch: pytest.MonkeyPatch, clock: FakeClock) -> None:
    capture = FakeCapture(clock, queued=1000)
    assert opened(monkeypatch, capture).camera.take().size == (640, 480)
    assert capture.number == opencv_camera.MOST_QUEUED


def test_unplugged_camera_is_said(monkeypatch: pytest.MonkeyPatch, clock: FakeClock) -> None:
    capture = FakeCapture(clock)
    with opened(monkeypatch, capture) as devices:
        devices.camera.take()
        capture.there = False
        with pytest.raises(DeviceError, match="unplugged"):
            devices.camera.take()
        devices.camera.close()
        with pytest.raises(DeviceError, match="closed"):
            devices.camera.take()
    assert capture.released == 1


def test_size_that_the_camera_has_not_is_refused(monkeypatch: pytest.MonkeyPatch, clock: FakeClock) -> None:
    capture = FakeCapture(clock, sizes=((640, 480), (1280, 720)))
    assert opened(monkeypatch, capture, "opencv:0,size=1280x720").camera.take().size == (1280, 720)
    with pytest.raises(InputError, match="it gives 640x480"):
        opened(monkeypatch, capture, "opencv:0,size=1000x1000")
    with pytest.raises(InputError, match="a size in pixels"):
        opened(monkeypatch, capture, "opencv:0,size=large")


def test_camera_that_is_not_there() -> None:
    with pytest.raises(InputError, match="camera 99 cannot be opened"):
        open_devices(camera="opencv:99")
    with pytest.raises(InputError, match="opencv:0"):
        open_devices(camera="opencv")


def test_video_plays_to_its_end(tmp_path: Path) -> None:
    file = tmp_path / "seen.avi"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
    for grey in (40, 120, 200):
        writer.write(np.full((48, 64, 3), grey, np.uint8))
    writer.release()
    camera = open_devices(camera=f"opencv:{file}").camera
    seen = [camera.take() for _ in range(3)]
    assert [round(float(p.colour.mean()) / 40) for p in seen] == [1, 3, 5]
    assert np.diff([p.time_s for p in seen]) == pytest.approx([0.1, 0.1], abs=1e-3)
    with pytest.raises(DeviceError, match="all 3 pictures"):
        camera.take()
