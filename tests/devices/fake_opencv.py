"""A fake of cv2.VideoCapture on a camera: a queue of old pictures, then one every 33 ms, until it is unplugged."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from tests.devices.fake_clock import FakeClock

from calibrant.opencv import cv2


class FakeCapture:
    """queued: pictures of before; the pixels of picture n are n."""

    def __init__(
        self, clock: FakeClock, *, queued: int = 4, sizes: tuple[tuple[int, int], ...] = ((640, 480),)
    ) -> None:
        self.clock, self.queued, self.sizes = clock, queued, sizes
        self.size, self.wanted = sizes[0], [0, 0]
        self.number, self.there, self.released = 0, True, 0

    def isOpened(self) -> bool:
        return True

    def grab(self) -> bool:
        if not self.there:
            return False
        if self.queued:
            self.queued -= 1
        else:
            self.clock.pass_time(0.033)
        self.number += 1
        return True

    def retrieve(self) -> tuple[bool, NDArray | None]:
        return True, np.full((self.size[1], self.size[0], 3), self.number, np.uint8)

    def set(self, prop: int, value: float) -> bool:
        if prop == cv2.CAP_PROP_FRAME_WIDTH:
            self.wanted[0] = int(value)
        if prop == cv2.CAP_PROP_FRAME_HEIGHT:
            self.wanted[1] = int(value)
            self.size = tuple(self.wanted) if tuple(self.wanted) in self.sizes else self.sizes[0]
        return True

    def get(self, prop: int) -> float:
        return float({cv2.CAP_PROP_FRAME_WIDTH: self.size[0], cv2.CAP_PROP_FRAME_HEIGHT: self.size[1]}.get(prop, 0))

    def release(self) -> None:
        self.released += 1
