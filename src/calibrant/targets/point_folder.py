"""Own points, image by image: a folder with a file beside each image that says what was seen where.

Which points an image shows, and where they lie on the target, is in its file alone (see `formats/points_yaml.py`). The
target may be flat or have depth. Nothing is known of what it looks like, so it can be neither printed nor detected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.targets import point_list
from calibrant.targets.lengths import METRES_PER_UNIT
from calibrant.targets.point_list import PointList
from calibrant.targets.scale import format_scale, split_scale
from calibrant.targets.target import Artwork, Target

SYNTAX = (
    f"{point_list.SYNTAX}; or points:DIR[:unit=mm] with a file beside each image, IMAGE.yml, of corners and obj in "
    "OpenCV's matrix format"
)
_UNIT = "unit="
_USUAL_UNIT = "mm"
"""3D-EasyCalib, whose files these are, writes the points of the target in millimetres."""


@dataclass(frozen=True)
class PointFolder(Target):
    """Files of own points in a folder; their lengths are in `unit`, and `scale` is a factor on all of them."""

    kind: ClassVar[str] = "points"

    folder: str
    unit: str = _USUAL_UNIT
    scale: float = 1.0

    @property
    def metres(self) -> float:
        """What the files' lengths are multiplied by."""
        return float(METRES_PER_UNIT[self.unit]) * self.scale

    @property
    def points(self) -> Array:
        """Raises: InputError, as every image has points of its own."""
        raise InputError(f"{self.spec}: its points are in the files beside the images; give images, or observations")

    @property
    def point_ids(self) -> NDArray[np.int64]:
        """Raises: InputError, as `points`."""
        return np.arange(len(self.points))

    @property
    def spec(self) -> str:
        """points:DIR, with the unit where it is not the usual one."""
        unit = "" if self.unit == _USUAL_UNIT else f":{_UNIT}{self.unit}"
        return f"{self.kind}:{self.folder}{unit}{format_scale(self.scale)}"

    def artwork(self) -> Artwork:
        """Raises: InputError, as nothing is known of what the points look like."""
        raise InputError(f"{self.spec}: own points have no artwork; print a target of another kind")

    def scaled(self, factor: float) -> PointFolder:
        """The same points times `factor`."""
        return replace(self, scale=self.scale * factor)


def parse(fields: Sequence[str]) -> PointFolder | PointList:
    """Target of a spec's fields after `points`: a folder of own points, or else a file with a list of points.

    Raises: InputError for an unknown unit, and as `point_list.parse`.
    """
    name, scale = split_scale(fields)
    head, _, last = name.rpartition(":")
    unit = _USUAL_UNIT
    if last.strip().lower().startswith(_UNIT):
        name, unit = head, last.strip()[len(_UNIT) :]
        if unit not in METRES_PER_UNIT:
            raise InputError(f"unknown unit {unit!r}; known units: {', '.join(METRES_PER_UNIT)}")
        if not Path(name).is_dir():
            raise InputError(f"there is no folder {name}; a unit goes with a folder of own points, points:DIR:unit=m")
    elif not name or not Path(name).is_dir():
        return point_list.parse(fields)
    return PointFolder(name, unit, scale)
