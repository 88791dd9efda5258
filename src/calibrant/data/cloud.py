"""A cloud: points in space with what is known of each, checked once at construction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Mask
from calibrant.errors import InputError

OWN_NAMES = ("x", "y", "z", "red", "green", "blue")
"""What `values` may not be called: these are the points and their colours."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points (n, 3), metres, in the frame named by `frame`, n >= 1.

    colours (n, 3), red, green, blue, 8 bits; values: further numbers a point by name, (n,) each, such as `sigma_z`,
    1 sigma of the depth in metres. Raises: InputError for no points, NaN, sizes that differ.

        >>> from calibrant.data.cloud import Cloud
        >>> cloud = Cloud([[0.0, 0.0, 1.0], [0.1, 0.0, 1.2]], values={"sigma_z": [0.001, 0.002]})
        >>> len(cloud), float(cloud.values["sigma_z"][1])
        (2, 0.002)
    """

    points: Array
    colours: NDArray[np.uint8] | None = None
    values: Mapping[str, Array] = field(default_factory=dict)
    frame: str = "camera"

    def __post_init__(self) -> None:
        points = np.array(self.points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(f"the points of a cloud are rows of x, y, z, shape (n, 3), got {points.shape}")
        if len(points) == 0:
            raise InputError("the cloud is empty: it has no points")
        bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
        if len(bad):
            raise InputError(
                f"point {bad[0]} of the cloud is NaN or infinite ({len(bad)} in all); leave such points out"
            )
        points.setflags(write=False)
        object.__setattr__(self, "points", points)
        if self.colours is not None:
            colours = np.array(self.colours)
            if colours.shape != points.shape or colours.dtype != np.uint8:
                raise InputError(
                    f"the colours of {len(points)} points are (n, 3) of 8 bits, got {colours.shape} of {colours.dtype}"
                )
            colours.setflags(write=False)
            object.__setattr__(self, "colours", colours)
        object.__setattr__(self, "values", {name: self._value(name, v) for name, v in self.values.items()})

    def _value(self, name: str, given: Array) -> Array:
        value = np.array(given, dtype=np.float64)
        if name in OWN_NAMES or not name.isidentifier():
            raise InputError(
                f"a cloud's values need a name of letters that is none of {', '.join(OWN_NAMES)}; {name!r}"
            )
        if value.shape != (len(self.points),):
            raise InputError(f"{name}: expected a number a point, ({len(self.points)},), got {value.shape}")
        value.setflags(write=False)
        return value

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        known = ["colours"] * (self.colours is not None) + list(self.values)
        return f"Cloud({len(self)} points, {self.frame} frame{', with ' + ', '.join(known) if known else ''})"

    def subset(self, keep: Mask) -> Cloud:
        """The points where keep (n,) is True. Raises: InputError where none is."""
        colours = None if self.colours is None else self.colours[keep]
        return Cloud(self.points[keep], colours, {n: v[keep] for n, v in self.values.items()}, self.frame)
