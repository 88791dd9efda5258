"""What the node asks of ROS, and the events that come from there; `bridge` is the real one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.tasks.live.picture import Picture


@dataclass(frozen=True, eq=False)
class Transform:
    """T_parent_child (4, 4) at a stamp in seconds; static: for all time."""

    parent: str
    child: str
    T_parent_child: Array
    stamp: float
    static: bool


@dataclass(frozen=True, eq=False)
class Info:
    """The fields of a camera_info message of a topic."""

    topic: str
    data: Mapping[str, Any]


Event = Picture | Transform | Info


class Transport(Protocol):
    """Where pictures, camera_info and transforms come from, and where results go."""

    def events(self) -> Sequence[Event] | None:
        """What came in since the last call, after waiting for it a moment; None when no more will come. Of pictures
        the newest few are kept. Raises: InputError where ROS cannot be reached."""
        ...

    def publish_static(self, transform: Transform) -> None:
        """Publish a transform for good: those who come later get it, too."""
        ...

    def publish_live(self, transform: Transform) -> None:
        """Publish a transform of now."""
        ...

    def publish_pose(self, transform: Transform, covariance: Array) -> None:
        """Publish where a frame is now, with its covariance (6, 6): a turn about the parent's axes, radians, and a
        shift along them, metres."""
        ...

    def show(self, picture: NDArray[np.uint8], *, frame: str, stamp: float) -> None:
        """Publish a picture (h, w, 3) in BGR."""
        ...

    def close(self) -> None:
        """End; nothing is published any more."""
        ...
