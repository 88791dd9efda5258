"""The cell's lamp."""

from __future__ import annotations

from dataclasses import dataclass

from calibrant.arrays import Array


@dataclass(frozen=True, eq=False)
class Light:
    """A lamp far away: the direction that its light goes (3,), ambient and diffuse grey, 0..1."""

    direction: Array
    ambient: float
    diffuse: float
