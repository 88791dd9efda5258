"""Cameras that OpenCV opens: `opencv:0`, `opencv:0,size=1280x720,fps=30`, a video file or a stream's address.

A camera that runs keeps some pictures in a queue; after a pause these are of before, when the arm was elsewhere. They
are dropped: what `take` gives was exposed after it was asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from calibrant.data.devices import DeviceCalibration, Picture
from calibrant.detection.images.files import VIDEOS
from calibrant.detection.images.images import to_bgr8
from calibrant.detection.live import open_capture
from calibrant.devices.driver import Driver, Opened
from calibrant.devices.host_time import now_s
from calibrant.devices.spec import DeviceSpec
from calibrant.devices.stated import stated_in
from calibrant.errors import DeviceError, InputError
from calibrant.opencv import cv2

MOST_QUEUED = 10
"""Pictures dropped at most: Video4Linux queues 4, other backends no more than 5."""
WAITED_S = 0.004
"""A grab that takes so long waited for its exposure; one from the queue takes a fraction. A camera of 250 a second."""


class OpenCVCamera:
    """A `cv2.VideoCapture` as `calibrant.data.CameraSource`.

    time_s: of the moment the picture arrived on this computer (a video's: its own); the exposure was a latency before.
    """

    stated: DeviceCalibration

    def __init__(
        self,
        capture: cv2.VideoCapture,
        name: str,
        *,
        live: bool,
        stated: DeviceCalibration | None = None,
        clock: Callable[[], float] = now_s,
    ) -> None:
        self.name, self.stated = name, stated or DeviceCalibration()
        self._capture, self._live, self._clock = capture, live, clock
        self._taken, self._open = 0, True

    def take(self) -> Picture:
        if not self._open:
            raise DeviceError(f"camera {self.name} gives no picture: it was closed")
        arrived = self._fresh() if self._live else self._grab()
        ok, image = self._capture.retrieve()
        if not ok or image is None:
            raise self._gone()
        time_s = arrived if self._live else 1e-3 * float(self._capture.get(cv2.CAP_PROP_POS_MSEC))
        self._taken += 1
        return Picture(f"{self.name} {self._taken - 1:06d}", to_bgr8(np.asarray(image)), time_s)

    def close(self) -> None:
        if self._open:
            self._open = False
            self._capture.release()

    def _fresh(self) -> float:
        """Grab until one had to be waited for; when it arrived."""
        for _ in range(MOST_QUEUED):
            asked = self._clock()
            arrived = self._grab()
            if arrived - asked >= WAITED_S:
                break
        return arrived

    def _grab(self) -> float:
        if not self._capture.grab():
            raise self._gone()
        return self._clock()

    def _gone(self) -> DeviceError:
        if not self._live:
            return DeviceError(f"{self.name} has ended: all {self._taken} pictures were taken")
        return DeviceError(
            f"camera {self.name} gives no picture any more, after {self._taken}: was it unplugged, or opened by "
            "another program? Plug it in and run again"
        )


def open_camera(spec: DeviceSpec) -> Opened:
    """Raises: InputError for a camera that is not there, or does not have the size."""
    source = spec.need_place("a camera's number, a video or an address: opencv:0")
    live = Path(source).suffix.lower() not in VIDEOS
    capture = open_capture(source)
    try:
        if live:
            _set(capture, spec)
        stated = stated_in(spec.options.get("lens"))
    except BaseException:
        capture.release()
        raise
    camera = OpenCVCamera(capture, f"opencv:{source}" if live else source, live=live, stated=stated)
    return Opened(cameras={source: camera})


def _set(capture: cv2.VideoCapture, spec: DeviceSpec) -> None:
    """The size and rate that were asked for. Raises: InputError where the camera has another size."""
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    if "fps" in spec.options:
        capture.set(cv2.CAP_PROP_FPS, spec.number("fps", 30.0))
    if "size" not in spec.options:
        return
    width, height = spec.size("size", (640, 480))
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, width)
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, height)
    got = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
    if got != (width, height):
        raise InputError(
            f"{spec.text}: the camera does not give {width}x{height}, it gives {got[0]}x{got[1]}; a lens is calibrated "
            "for one size, so ask for one that the camera has"
        )


DRIVER = Driver(
    name="opencv",
    form="opencv:N|FILE|ADDRESS[,size=1280x720,fps=30,lens=FILE]",
    gives=("camera",),
    says="a camera that OpenCV opens, a video file or a stream",
    tested="video files, and a fake of a camera; untested on a camera",
    connect=open_camera,
    keys=("size", "fps", "lens"),
)
