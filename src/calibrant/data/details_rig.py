"""What a rig's calibration found beside its cameras and transforms: records of `calibrant.data.details`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SharedMoments:
    """At how many moments every two cameras saw a target, or targets fixed to each other, that the calibration used.

    counts[i][j]: of cameras i and j together; counts[i][i]: of camera i at all.
    """

    cameras: tuple[str, ...]
    counts: tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class CameraClock:
    """When a camera takes its pictures: how much later than the reference's clock their middle row is, and how long
    after its first row the last one is, ms with 1 sigma; None for what was not asked."""

    camera: str
    offset_ms: float | None = None
    offset_sigma_ms: float | None = None
    readout_ms: float | None = None
    readout_sigma_ms: float | None = None


@dataclass(frozen=True)
class CameraClocks:
    """The clocks of a rig's cameras against that of the reference."""

    reference: str
    clocks: tuple[CameraClock, ...]
