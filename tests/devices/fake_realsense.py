"""A fake of pyrealsense2 2.5x: pipeline, config, align, stream profiles and frames as documented."""

from __future__ import annotations

import sys
from enum import Enum
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant.geometry import rotations, se3

SCALE = 0.001
T_colour_depth = se3.make(rotations.matrix_from_rotation_vector([0.001, 0.002, -0.003], unit="rad"), [0.015, 0, 0.001])


class Stream(Enum):
    depth = 1
    color = 2


class Distortion(Enum):
    none = 0
    brown_conrady = 4
    inverse_brown_conrady = 2


class Domain(Enum):
    hardware_clock = 0
    system_time = 1
    global_time = 2


class Camera:
    """What the fake's camera is, and what happens to it."""

    def __init__(self) -> None:
        self.there, self.running, self.number = True, False, 0
        self.serial: str | None = None
        self.domain = Domain.global_time
        self.coeffs = [0.0] * 5
        self.model = Distortion.inverse_brown_conrady
        self.streams: dict[Stream, tuple[int, int]] = {}
        self.queued = 0
        self.stopped = 0

    def frame(self, stream: Stream) -> Frame:
        width, height = self.streams[stream]
        if stream is Stream.color:
            return Frame(self, np.full((height, width, 3), self.number % 250, np.uint8))
        depth = np.full((height, width), 800, np.uint16)
        depth[0, 0] = 0
        return Frame(self, depth)


class Frame:
    def __init__(self, camera: Camera, data: NDArray) -> None:
        self.camera, self.data, self.number = camera, data, camera.number

    def get_data(self) -> NDArray:
        return self.data

    def get_timestamp(self) -> float:
        return 1.7e12 + 33.0 * self.number

    def get_frame_timestamp_domain(self) -> Domain:
        return self.camera.domain


class Frames:
    def __init__(self, camera: Camera, *, aligned: bool = False) -> None:
        self.camera, self.aligned = camera, aligned

    def get_color_frame(self) -> Frame:
        return self.camera.frame(Stream.color)

    def get_depth_frame(self) -> Frame:
        if self.aligned:
            width, height = self.camera.streams[Stream.color]
            return Frame(self.camera, np.full((height, width), 800, np.uint16))
        return self.camera.frame(Stream.depth)


class Profile:
    """Of one stream, and of the pipeline."""

    def __init__(self, camera: Camera, stream: Stream = Stream.color) -> None:
        self.camera, self.stream = camera, stream

    def get_stream(self, stream_type: Stream, stream_index: int = -1) -> Profile:
        return Profile(self.camera, stream_type)

    def get_device(self):
        return SimpleNamespace(first_depth_sensor=lambda: SimpleNamespace(get_depth_scale=lambda: SCALE))

    def as_video_stream_profile(self) -> Profile:
        return self

    def get_intrinsics(self):
        width, height = self.camera.streams[self.stream]
        return SimpleNamespace(
            width=width, height=height, fx=615.0, fy=616.0, ppx=321.0, ppy=239.0, model=self.camera.model,
            coeffs=self.camera.coeffs,
        )  # fmt: skip

    def get_extrinsics_to(self, to: Profile):
        assert (self.stream, to.stream) == (Stream.depth, Stream.color)
        return SimpleNamespace(rotation=T_colour_depth[:3, :3].ravel("F").tolist(),
                               translation=T_colour_depth[:3, 3].tolist())  # fmt: skip


def make_module(camera: Camera) -> ModuleType:
    """pyrealsense2."""

    class Config:
        def enable_device(self, serial: str) -> None:
            camera.serial = serial

        def enable_stream(self, stream_type, width, height, format, framerate) -> None:  # noqa: A002 - the library's
            camera.streams[stream_type] = (width, height)

    class Pipeline:
        def start(self, config: Config) -> Profile:
            if not camera.there:
                raise RuntimeError("No device connected")
            camera.running = True
            return Profile(camera)

        def poll_for_frames(self) -> Frames:
            if camera.queued:
                camera.queued, camera.number = 0, camera.number + 1
            return Frames(camera)

        def wait_for_frames(self, timeout_ms: int = 5000) -> Frames:
            if not camera.there:
                raise RuntimeError(f"Frame didn't arrive within {timeout_ms}")
            camera.number += 1
            return Frames(camera)

        def stop(self) -> None:
            if not camera.running:
                raise RuntimeError("stop() cannot be called before start()")
            camera.running = False
            camera.stopped += 1

    class Align:
        def __init__(self, align_to: Stream) -> None:
            assert align_to is Stream.color

        def process(self, frames: Frames) -> Frames:
            return Frames(camera, aligned=True)

    module = ModuleType("pyrealsense2")
    module.pipeline, module.config, module.align = Pipeline, Config, Align
    module.stream, module.distortion, module.timestamp_domain = Stream, Distortion, Domain
    module.format = SimpleNamespace(bgr8="bgr8", z16="z16")
    return module


def installed(monkeypatch: pytest.MonkeyPatch) -> Camera:
    """The fake in place of the library."""
    camera = Camera()
    monkeypatch.setitem(sys.modules, "pyrealsense2", make_module(camera))
    return camera
