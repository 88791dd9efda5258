"""One clock for the devices of one computer: seconds since 1970 on it, for robots, cameras and whoever waits.

Makers' clocks begin when their device does; stamped here, a robot's moments and a camera's can be compared. How much
later than its exposure a picture is stamped is its latency, which `servoing.conveyor.latency` finds from pictures.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from calibrant.cancel import checkpoint

TICK_S = 0.008
"""Between two looks while something moves: controllers report at 125 Hz or more."""


def now_s() -> float:
    """Seconds."""
    return time.time()


def sleep_s(seconds: float) -> None:
    """Let time pass."""
    time.sleep(max(0.0, seconds))


def pause(seconds: float, look: Callable[[], object] | None = None) -> None:
    """Let time pass, and look at every tick: what it raises ends the pause. Raises: CancelledError on request."""
    end = time.monotonic() + seconds
    while True:
        checkpoint()
        if look is not None:
            look()
        left = end - time.monotonic()
        if left <= 0:
            return
        sleep_s(min(TICK_S, left))
