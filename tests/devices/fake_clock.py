"""A clock for fakes of devices: time passes when somebody sleeps, and what moves is moved then."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from calibrant.devices import host_time


class FakeClock:
    """Stands in for the module `time`. move: called with the seconds of each step."""

    def __init__(self) -> None:
        self.now = 1_700_000_000.0
        self.movers: list[Callable[[float], None]] = []

    def time(self) -> float:
        return self.now

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.pass_time(seconds)

    def pass_time(self, seconds: float) -> None:
        self.now += seconds
        for move in self.movers:
            move(seconds)


def patched_clock(monkeypatch: pytest.MonkeyPatch) -> FakeClock:
    clock = FakeClock()
    monkeypatch.setattr(host_time, "time", clock)
    return clock
