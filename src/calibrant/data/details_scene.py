"""What is found of a scene: a projector's captures, objects before a camera. Records of `calibrant.data.details`."""

from __future__ import annotations

from dataclasses import dataclass

Row = tuple[float, float, float, float]


@dataclass(frozen=True)
class ProjectorCapture:
    """A capture of a board: corners in camera and projector, shares of the board that were decoded, lit directly and
    saturated, sigma of a typical pixel (projector px), noise (grey levels), what spoils the light (see
    `detection.structured_light.judged`); rms_px of its corners in the projector, where it counts."""

    name: str
    corners: int
    carried: int
    decoded: float
    direct: float
    saturated: float
    sigma_px: float
    noise: float
    bend: float
    alike: float | None = None
    stripes: float | None = None
    rms_px: float | None = None


@dataclass(frozen=True)
class ProjectorCaptures:
    """The captures of a projector's calibration, and the patterns shown."""

    code: str
    patterns: int
    captures: tuple[ProjectorCapture, ...]


@dataclass(frozen=True)
class LocatedObject:
    """An object before a camera. name; words: how its shape was read; segment_px: middle of its segment; area_px.

    symmetries: T_object_same, 4x4, the identity first: the pose times each of them looks the same. undetermined:
    directions that the data do not tell. faces: how many of its sides the depth shows; overlap: of the drawn shape and
    the segment, 0 to 1.
    """

    name: str
    words: str
    segment_px: tuple[float, float]
    area_px: int
    symmetries: tuple[tuple[Row, Row, Row, Row], ...]
    undetermined: tuple[str, ...] = ()
    faces: int = 0
    overlap: float = 0.0
