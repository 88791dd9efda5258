"""Records of a projector's calibration (see `details`)."""

from __future__ import annotations

from dataclasses import dataclass


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
