"""Where a result's cameras are, in one frame: what every format of several cameras writes."""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.geometry.frames import FrameGraph

IMU = "imu"
"""What the frame of an inertial unit is called where a file gives it no name."""


def graph_of(result: CalibrationResult) -> FrameGraph:
    """The result's frames and the transforms between them. Raises: InputError where two of them contradict."""
    graph = FrameGraph()
    for t in result.transforms:
        graph = graph.add(t.parent, t.child, t.matrix)
    return graph


def world_of(result: CalibrationResult, asked: str | None = None) -> str:
    """The frame that others are placed in: the one asked for, else the parent of the first transform, else the only
    camera's. Raises: InputError for a frame that is not there."""
    frames = list(dict.fromkeys([*(name for t in result.transforms for name in (t.parent, t.child)), *result.cameras]))
    if not frames:
        raise InputError("no frame in it: no camera and no transform")
    if asked is not None and asked not in frames:
        raise InputError(f"no frame {asked!r}; frames: {', '.join(frames)}")
    return asked if asked is not None else frames[0]


def places_in(result: CalibrationResult, world: str, names: tuple[str, ...]) -> dict[str, Array]:
    """T_world_name (4, 4) of each. Raises: InputError where no chain of transforms leads there."""
    graph = graph_of(result)
    return {name: np.eye(4) if name == world else graph.T(world, name) for name in names}


def imu_frame(result: CalibrationResult, asked: str | None) -> str | None:
    """The frame that is the IMU: the one asked for, else one whose name begins so. Raises: InputError for none such."""
    frames = dict.fromkeys(name for t in result.transforms for name in (t.parent, t.child))
    if asked is not None:
        if asked not in frames:
            raise InputError(f"no frame {asked!r}; frames: {', '.join(frames) or 'none'}")
        return asked
    return next((f for f in frames if f not in result.cameras and f.lower().startswith(IMU)), None)
