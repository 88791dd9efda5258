"""RealSense cameras through pyrealsense2: `realsense`, `realsense:SERIAL,size=1280x720`. **Untested on hardware.**

Written after librealsense 2.5x's documented Python interface (pipeline, align, stream profiles), and tested against a
fake of it. Depth comes aligned to the colour picture by the maker's figures; with depth=own it stays in its own grid,
and `stated` says where its camera is: what registers depth by a calibration of its own takes that.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from calibrant.cameras import Camera
from calibrant.data.devices import DeviceCalibration, Picture
from calibrant.devices.driver import Driver, Opened
from calibrant.devices.extras import makers_library
from calibrant.devices.host_time import now_s
from calibrant.devices.spec import DeviceSpec
from calibrant.errors import DeviceError
from calibrant.geometry import se3

DEPTHS = ("aligned", "own", "none")
TIMEOUT_MS = 5000
"""The library's own: a camera gives 6 pictures a second or more."""
SETTLE = 15
"""Pictures after the start that are dropped: the exposure finds itself in the first half second."""


class RealSenseCamera:
    """A RealSense as `calibrant.data.CameraSource`. Untested on hardware.

    rs: the library; pipeline: started; profile: what it gave. time_s: the exposure's, where the camera's clock is tied
    to this computer's (global time), else when the picture arrived.
    """

    def __init__(self, rs: Any, pipeline: Any, profile: Any, name: str, *, depth: str = "aligned") -> None:
        self.name = name
        self._rs, self._pipeline, self._depth = rs, pipeline, depth
        self._align = rs.align(rs.stream.color) if depth == "aligned" else None
        self._metres = 1.0 if depth == "none" else _answer(profile.get_device().first_depth_sensor().get_depth_scale)
        self.stated = stated_of(rs, profile, depth)
        self._taken, self._open = 0, True

    def take(self) -> Picture:
        if not self._open:
            raise DeviceError(f"camera {self.name} gives no picture: it was closed")
        frames = self._next()
        colour = frames.get_color_frame()
        deep = None if self._depth == "none" else frames.get_depth_frame()
        if not colour or (self._depth != "none" and not deep):
            raise DeviceError(f"camera {self.name} gave a set without {'depth' if colour else 'colour'}; take again")
        self._taken += 1
        return Picture(
            f"{self.name} {self._taken - 1:06d}",
            np.array(colour.get_data(), dtype=np.uint8),
            self._exposed(colour),
            None if deep is None else self._in_metres(deep),
        )

    def close(self) -> None:
        if not self._open:
            return
        self._open = False
        try:
            self._pipeline.stop()
        except RuntimeError:
            return  # the camera is gone: there is nothing to stop

    def drop(self, count: int) -> None:
        """Let pictures pass. Raises: DeviceError."""
        for _ in range(count):
            self._next()

    def _next(self) -> Any:
        """The latest set of frames, exposed after it was asked for: of a queue, the first is of before."""
        try:
            self._pipeline.poll_for_frames()
            frames = self._pipeline.wait_for_frames(TIMEOUT_MS)
            return frames if self._align is None else self._align.process(frames)
        except RuntimeError as error:
            raise DeviceError(
                f"camera {self.name} gives no picture any more, after {self._taken}: {error}. Was it unplugged?"
            ) from error

    def _exposed(self, frame: Any) -> float:
        domains = self._rs.timestamp_domain
        if frame.get_frame_timestamp_domain() in (domains.global_time, domains.system_time):
            return 1e-3 * float(frame.get_timestamp())
        return now_s()

    def _in_metres(self, frame: Any) -> np.ndarray[Any, np.dtype[np.float32]]:
        z = self._metres * np.array(frame.get_data(), dtype=np.float64)
        z[z <= 0] = np.nan
        return z.astype(np.float32)


def stated_of(rs: Any, profile: Any, depth: str) -> DeviceCalibration:
    """What the camera says of its lenses. Aligned depth has the colour's grid, and its place."""
    colour_stream = profile.get_stream(rs.stream.color)
    colour = _lens(rs, colour_stream)
    if depth == "none":
        return DeviceCalibration(colour)
    if depth == "aligned":
        return DeviceCalibration(colour, colour, None if colour is None else np.eye(4))
    deep_stream = profile.get_stream(rs.stream.depth)
    away = deep_stream.get_extrinsics_to(colour_stream)
    T = se3.make(np.reshape(away.rotation, (3, 3), order="F"), np.asarray(away.translation, dtype=np.float64))
    return DeviceCalibration(colour, _lens(rs, deep_stream), T)


def _lens(rs: Any, stream: Any) -> Camera | None:
    """The camera of a stream; None for a distortion that no model here has.

    librealsense counts pixels from the centre of the first, as is done here; coeffs are k1, k2, p1, p2, k3.
    """
    said = stream.as_video_stream_profile().get_intrinsics()
    values = {"fx": said.fx, "fy": said.fy, "cx": said.ppx, "cy": said.ppy}
    values = {key: float(value) for key, value in values.items()}
    size = (int(said.width), int(said.height))
    bent = [float(c) for c in said.coeffs]
    if not any(bent):
        return Camera.create("pinhole", values, image_size=size)
    if said.model == rs.distortion.brown_conrady:
        return Camera.create(
            "brown", {**values, **dict(zip(("k1", "k2", "p1", "p2", "k3"), bent, strict=True))}, image_size=size
        )
    return None


def open_camera(spec: DeviceSpec) -> Opened:
    """Start the camera. Raises: MissingExtraError without pyrealsense2; DeviceError where there is none."""
    rs = makers_library("pyrealsense2", package="pyrealsense2", what="a RealSense camera")
    depth = spec.one_of("depth", DEPTHS, "aligned")
    width, height = spec.size("size", (640, 480))
    rate = spec.whole("fps", 30)
    pipeline, config = rs.pipeline(), rs.config()
    if spec.place:
        config.enable_device(spec.place)
    config.enable_stream(rs.stream.color, width, height, rs.format.bgr8, rate)
    if depth != "none":
        deep = spec.size("depth-size", (width, height))
        config.enable_stream(rs.stream.depth, *deep, rs.format.z16, rate)
    name = f"realsense {spec.place}".strip()
    try:
        profile = pipeline.start(config)
    except RuntimeError as error:
        raise DeviceError(
            f"{name} does not start: {error}. Is it plugged into USB 3, and does it have {width}x{height} at {rate} "
            "pictures a second?"
        ) from error
    try:
        camera = RealSenseCamera(rs, pipeline, profile, name, depth=depth)
        camera.drop(SETTLE)
    except BaseException:
        pipeline.stop()
        raise
    return Opened(cameras={name: camera})


def _answer(question: Any) -> float:
    return float(question())


DRIVER = Driver(
    name="realsense",
    form="realsense[:SERIAL,size=640x480,fps=30,depth=aligned|own|none,depth-size=848x480]",
    gives=("camera",),
    says="a RealSense camera, colour and depth",
    tested="a fake of pyrealsense2 2.5x; untested on hardware",
    connect=open_camera,
    keys=("size", "fps", "depth", "depth-size"),
    extra="devices",
)
