"""What the commands of `calibrant verify` found by a task: the watched pictures, and runs with their errors."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class WatchedPicture:
    """A picture of a watched camera: chance of as much, up to it, where nothing moved (None where it was not looked
    at), and what is to be said of it."""

    name: str
    chance: float | None
    remark: str = ""


@dataclass(frozen=True)
class Watching:
    """What `verify watch` found: the answer, what to do, the pictures in their order.

    run: pictures between two false alarms in the mean; since, at: the first picture after the move and the one that
    told, None where there was none.
    """

    answer: str
    advice: str
    run: float
    pictures: tuple[WatchedPicture, ...]
    since: str | None = None
    at: str | None = None
