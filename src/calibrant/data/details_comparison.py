"""Two results beside each other: what `calibrant compare` found."""

from __future__ import annotations

from dataclasses import dataclass

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class ParameterDifference:
    """A parameter of both cameras, each with 1 sigma; None where one of them has no such term or states no sigma.

    difference: second less first; sigma, of the difference, the two taken as independent.
    """

    name: str
    unit: str
    first: float | None
    second: float | None
    first_sigma: float | None = None
    second_sigma: float | None = None
    difference: float | None = None
    sigma: float | None = None

    @property
    def sigmas(self) -> float | None:
        """How many sigma they are apart."""
        return None if self.difference is None or not self.sigma else abs(self.difference) / self.sigma


@dataclass(frozen=True)
class DifferenceMap:
    """Where the second camera sees what the first sees at a pixel, less that pixel, the implied rotation removed.

    On columns x rows pixels (u, v), row by row: du, dv and 1 sigma (worst axis), pixels; None where one camera sees
    nothing, and for a sigma that is not known.
    """

    columns: int
    rows: int
    u: tuple[float, ...]
    v: tuple[float, ...]
    du: tuple[float | None, ...]
    dv: tuple[float | None, ...]
    sigma: tuple[float | None, ...]


@dataclass(frozen=True)
class CameraComparison:
    """Two cameras: rms and largest difference over the image, pixels of the first, before and after the implied
    rotation is removed, that rotation (vector along the first camera's axes, mrad) and its 1 sigma.

    expected_px: rms of the differences (after) that the two uncertainties make; chance: of differences as large from
    them alone; None where a camera states no uncertainty. shared: the part of the image that both see.
    """

    first: str
    second: str
    first_model: str
    second_model: str
    first_size: tuple[int, int]
    second_size: tuple[int, int]
    rms_px: float
    most_px: float
    rotated_rms_px: float
    rotated_most_px: float
    rotation_mrad: Triple
    rotation_sigma_mrad: Triple | None
    expected_px: float | None
    chance: float | None
    shared: float
    parameters: tuple[ParameterDifference, ...]
    map: DifferenceMap


@dataclass(frozen=True)
class TransformComparison:
    """A transform of both, second less first along the parent's axes: mm, and the turn as a vector, degrees.

    chance: of a difference as large from the two uncertainties alone, taken as independent. via: the frames between,
    where one of the two has it by a chain of transforms.
    """

    parent: str
    child: str
    mm: Triple
    deg: Triple
    mm_sigma: Triple | None = None
    deg_sigma: Triple | None = None
    chance: float | None = None
    via: tuple[str, ...] = ()


@dataclass(frozen=True)
class Comparison:
    """first, second: what the two are called; only_first, only_second: cameras and transforms of one of them alone."""

    first: str
    second: str
    cameras: tuple[CameraComparison, ...] = ()
    transforms: tuple[TransformComparison, ...] = ()
    only_first: tuple[str, ...] = ()
    only_second: tuple[str, ...] = ()
