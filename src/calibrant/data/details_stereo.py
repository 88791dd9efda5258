"""What a stereo calibration found beside its cameras and transform: records of `calibrant.data.details`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

Row = tuple[float, float, float]
Matrix = tuple[Row, Row, Row]


@dataclass(frozen=True)
class StereoGeometry:
    """The pair as OpenCV has it: X_right = R X_left + t, with t in metres.

    E = [t]x R, with x_right^T E x_left = 0 for ideal coordinates (x, y, 1); F = K_right^-T E K_left^-1, the same for
    undistorted pixels. left, right: names of the cameras.
    """

    left: str
    right: str
    R: Matrix
    t_m: Row
    E: Matrix
    F: Matrix


@dataclass(frozen=True)
class PairErrors:
    """Epipolar errors of the points of a pair: how far each lies from the line of its partner, undistorted pixels.

    left, right: ids of the views; point_ids: those that both saw; left_px and right_px: distances in each image; rms,
    min and max are over both.
    """

    left: str
    right: str
    rms_px: float
    min_px: float
    max_px: float
    point_ids: tuple[int, ...]
    left_px: tuple[float, ...]
    right_px: tuple[float, ...]


@dataclass(frozen=True)
class EpipolarErrors:
    """Epipolar errors of a stereo pair, over all and by moment; expected_px: what the pixels' noise makes of them."""

    rms_px: float
    min_px: float
    max_px: float
    expected_px: float
    pairs: Mapping[str, PairErrors]


@dataclass(frozen=True)
class TriangulatedEdges:
    """Distances between neighbouring points of the board, triangulated, less what they are: rms and mean, mm."""

    count: int
    rms_mm: float
    mean_mm: float
    length_mm: float


@dataclass(frozen=True)
class EpipolarMatrices:
    """Of two pictures: F, u_right^T F u_left = 0 for their pixels, and E, r_right^T E r_left = 0 for rays; norm 1."""

    F: Matrix | None = None
    E: Matrix | None = None
