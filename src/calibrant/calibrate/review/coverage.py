"""How views cover the image and the space before the camera, and in words, which view is missing.

A camera model is only known where points were seen: distortion grows with the radius, so empty corners are
extrapolated. The focal length is only known from tilted boards: parallel boards leave it undetermined (Zhang, A
Flexible New Technique for Camera Calibration, 2000, section 5, where 5 deg of tilt often fails and 45 deg is best).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrant.arrays import Array
from calibrant.calibrate.review.corners import CORNERS, corner_sigmas, enough_of
from calibrant.calibrate.review.residuals import ViewResiduals, fitted_poses, structure_check, view_residuals
from calibrant.data import CalibrationResult, Check, View
from calibrant.data.details import SharedErrors
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.percent import percent

GRID = (12, 9)
"""Columns and rows of the occupancy map: cells about as big as a square of a board that fills the image."""
_CORNER_SHARE = 0.2
"""Side of a corner region over the image's: it begins at 60 % of the half diagonal, where distortion takes hold."""
_LEAST_OCCUPIED = 0.5
"""Less than half the image seen leaves more extrapolated than known."""
_TILT_DEG = 20.0
"""From here on a view adds to the focal length; two directions of tilt are needed (Zhang 2000, figure 4)."""
_TILTED_VIEWS = 2
_LEAST_DIRECTION_DEG = 5.0
"""Spread of the board's normal across its main direction of tilt; below it all tilts are about one axis."""
_LEAST_DISTANCE_RATIO = 1.2
"""Farthest over nearest view; closer than that, the calibration stands for one distance only."""
_CORNER_KNOWN = 0.01
"""1 sigma in a corner over the focal length: the limit that the focal length's own check has, 10 mm at 1 m."""


@dataclass(frozen=True, eq=False)
class Coverage:
    """Where points fell: counts (rows, columns) over the image, and the points in each corner region."""

    counts: NDArray[np.int64]
    corner_points: dict[str, int]

    @property
    def occupied(self) -> float:
        """Share of the cells that hold a point."""
        return float(np.mean(self.counts > 0))

    @property
    def empty_corners(self) -> tuple[str, ...]:
        """Names of the corner regions without a point."""
        return tuple(name for name, points in self.corner_points.items() if points == 0)


@dataclass(frozen=True, eq=False)
class Spread:
    """How the boards stood: tilt (n,) of each from facing the camera, degrees; distance (n,) of each centre, metres.

    weakest_tilt_deg is the spread of the normals across the main direction of tilt; weakest_axis ("left or right",
    "up or down") says which way of tilting is missing most.
    """

    tilt_deg: Array
    distance: Array
    weakest_tilt_deg: float
    weakest_axis: str


@dataclass(frozen=True, eq=False)
class CameraCoverage:
    """What the used views of one camera cover, and the checks that follow."""

    camera: str
    image_size: tuple[int, int]
    coverage: Coverage
    checks: tuple[Check, ...]


def camera_coverage(result: CalibrationResult) -> tuple[CameraCoverage, ...]:
    """Coverage of each camera that has used views, with the checks of `coverage_checks`, `spread_checks`, residuals.

    Views without a pose count for the image only. Empty for results without observations.
    """
    if result.observations is None:
        return ()
    poses = fitted_poses(result)
    return covered(result, poses, view_residuals(result, poses))


def covered(
    result: CalibrationResult,
    poses: Mapping[tuple[str, str], Array],
    residuals: Sequence[ViewResiduals],
    structures: Mapping[str, Check] | None = None,
) -> tuple[CameraCoverage, ...]:
    """`camera_coverage` with the poses by (camera, view id), the residuals, and the answers of `structure_check` by
    camera, that somebody has computed already."""
    if result.observations is None:
        return ()
    left_out = {(result.camera_of(v), v.id) for v in result.views if not v.used}
    out = []
    for camera, size in result.observations.image_sizes.items():
        mine = [v for v in result.observations.views if v.camera == camera and len(v)]
        seen = [v for v in mine if (camera, v.id) not in left_out]
        if not seen:
            continue
        coverage = image_coverage([v.uv for v in seen], image_size=size)
        posed = [v for v in seen if (camera, v.id) in poses]
        checks = coverage_checks(coverage, _known_corners(result, camera, coverage, posed, poses))
        if posed:
            spread = board_spread([poses[camera, v.id] for v in posed], _centres(posed))
            structure = (structures or {}).get(camera)
            if structure is None:
                structure = structure_check(
                    tuple(r for r in residuals if r.camera == camera),
                    image_size=size,
                    held=result.detail(SharedErrors) is not None,
                )
            checks += (*spread_checks(spread), structure)
        out.append(CameraCoverage(camera, size, coverage, checks))
    return tuple(out)


def _centres(views: Sequence[View]) -> Array:
    """The middle (n, 3) of each view's points, of all at once: NumPy's mean of one takes longer than its numbers."""
    counts = np.array([len(v) for v in views])
    axes = np.concatenate([v.points for v in views]).T
    return np.add.reduceat(np.ascontiguousarray(axes), np.cumsum(counts) - counts, axis=1).T / counts[:, None]


def _known_corners(
    result: CalibrationResult,
    camera: str,
    coverage: Coverage,
    posed: Sequence[View],
    poses: Mapping[tuple[str, str], Array],
) -> dict[str, float] | None:
    """1 sigma over the focal length in the corners without points; None where the lens has no covariance."""
    lens = result.cameras.get(camera)
    if lens is None or lens.covariance is None or not posed or not coverage.empty_corners:
        return None
    view = np.repeat(np.arange(len(posed)), [len(v) for v in posed])
    some = enough_of(len(view))
    T = np.stack([poses[camera, v.id] for v in posed])[view[some]]
    seen = se3.apply(T, np.concatenate([v.points for v in posed])[some])
    focal = float(np.sqrt(lens.parameters["fx"] * lens.parameters["fy"]))
    return {name: px / focal for name, px in corner_sigmas(lens, seen, coverage.empty_corners).items()}


def with_coverage_checks(
    result: CalibrationResult, coverage: Sequence[CameraCoverage] | None = None
) -> CalibrationResult:
    """The result with the checks of `camera_coverage` it does not have yet; a warning turns a verdict "ok" to "warn".

    For results that estimate a camera: coverage says where its model is extrapolated. Args: coverage, where somebody
    has computed it already.
    """
    known = {check.name for check in result.checks}
    found = camera_coverage(result) if coverage is None else coverage
    new = [
        replace(check, name=check.name if len(found) == 1 else f"{check.name}-{item.camera}")
        for item in found
        for check in item.checks
    ]
    checks = (*result.checks, *(check for check in new if check.name not in known))
    worse = result.verdict == "ok" and any(check.status == "warn" for check in checks)
    return replace(result, checks=checks, verdict="warn" if worse else result.verdict)


def image_coverage(uv: Iterable[ArrayLike], *, image_size: tuple[int, int]) -> Coverage:
    """Occupancy of the image by the points of all views.

    Args: uv, an (n, 2) array of pixels a view; image_size (width, height) px.
    Raises: InputError when there is no view.
    """
    arrays = [np.asarray(pixels, dtype=np.float64).reshape(-1, 2) for pixels in uv]
    if not arrays:
        raise InputError("coverage of the image needs at least one view; none was used")
    # Pixel (0, 0) is the centre of the first pixel: the image spans -0.5 … width - 0.5.
    across, down = ((x + 0.5) / size for x, size in zip(np.concatenate(arrays).T, image_size))
    column, row = (np.clip(x * n, 0, n - 1).astype(np.int64) for x, n in zip((across, down), GRID))
    counts = np.bincount(row * GRID[0] + column, minlength=GRID[0] * GRID[1]).reshape(GRID[::-1])
    corner_points = {}
    for name, (x, y) in CORNERS.items():
        inside = (np.abs(across - x) <= _CORNER_SHARE) & (np.abs(down - y) <= _CORNER_SHARE)
        corner_points[name] = int(np.count_nonzero(inside))
    return Coverage(counts, corner_points)


def board_spread(T_camera_target: Sequence[Array], centres: Sequence[ArrayLike] | Array) -> Spread:
    """Tilts and distances of the boards.

    Args: T_camera_target, a (4, 4) a view; centres, the middle of each view's points (3,) metres, target frame.
    Raises: InputError when there is no view.
    """
    if not len(T_camera_target):
        raise InputError("the spread of boards needs at least one view with a pose; none has one")
    T = np.stack(list(T_camera_target))
    normal = T[:, :3, 2] * np.where(T[:, 2, 2] < 0, -1.0, 1.0)[:, None]
    tilt = np.rad2deg(np.arccos(np.clip(normal[:, 2], -1.0, 1.0)))
    distance = np.linalg.norm(se3.apply(T, np.asarray(centres, dtype=np.float64)), axis=-1)
    # The normal's x, y as an angle in degrees along each direction; its second moment about facing the camera.
    direction = normal[:, :2] / np.maximum(np.linalg.norm(normal[:, :2], axis=-1, keepdims=True), 1e-12)
    moved = direction * tilt[:, None]
    values, vectors = np.linalg.eigh(moved.T @ moved / len(moved))
    weakest = vectors[:, 0]
    axis = "left or right" if abs(weakest[0]) > abs(weakest[1]) else "up or down"
    return Spread(tilt, distance, float(np.sqrt(max(values[0], 0.0))), axis)


def coverage_checks(coverage: Coverage, corner_sigma: Mapping[str, float] | None = None) -> tuple[Check, ...]:
    """Checks "image-coverage" (value: share of cells with points) and "corner-coverage" (value: corners seen).

    Args: corner_sigma, 1 sigma over the focal length in the corners without points, where the lens's covariance says
    it; NaN where the lens shows nothing. A corner that the views elsewhere determine needs none of its own.
    """
    share = coverage.occupied
    text = f"points in {100 * share:.0f} % of the image"
    if share < _LEAST_OCCUPIED:
        where = _emptiest_side(coverage.counts)
        image = Check("image-coverage", "warn", f"{text} only: take views with the board in the {where} as well", share)
    else:
        image = Check("image-coverage", "ok", text, share)
    empty = coverage.empty_corners
    filled = float(len(coverage.corner_points) - len(empty))
    if empty:
        return image, _empty_corners(empty, len(coverage.corner_points), corner_sigma, filled)
    return image, Check("corner-coverage", "ok", "points in all four corners of the image", filled)


def _empty_corners(
    empty: Sequence[str], corners: int, corner_sigma: Mapping[str, float] | None, filled: float
) -> Check:
    """ "corner-coverage" where corners have no points: do the other views determine the lens there?"""
    where = _listed(empty, corners)
    if corner_sigma is None:
        message = f"no points in the {where}: take a view with the board there; distortion is extrapolated until then"
        return Check("corner-coverage", "warn", message, filled)
    unknown = [name for name in empty if corner_sigma[name] > _CORNER_KNOWN]
    if unknown:
        most = max(corner_sigma[name] for name in unknown)
        message = (
            f"no points in the {_listed(unknown, corners)}, where the lens is known to {percent(most)} of the focal "
            "length only (1 sigma): take a view with the board there"
        )
        return Check("corner-coverage", "warn", message, filled)
    known = [corner_sigma[name] for name in empty if np.isfinite(corner_sigma[name])]
    said = f"; the lens is known there to {percent(max(known))} of the focal length (1 sigma)" if known else ""
    return Check("corner-coverage", "ok", f"no points in the {where}{said}", filled)


def _listed(names: Sequence[str], corners: int) -> str:
    """Corners in words."""
    return "four corners" if len(names) == corners else f"{' and the '.join(names)} corner{'s' * (len(names) > 1)}"


def spread_checks(spread: Spread) -> tuple[Check, ...]:
    """Checks "tilt-range" (value: largest tilt, degrees) and "distance-range" (value: farthest over nearest)."""
    return _tilt_check(spread), _distance_check(spread)


def _tilt_check(spread: Spread) -> Check:
    low, high = float(spread.tilt_deg.min()), float(spread.tilt_deg.max())
    tilted = int(np.sum(spread.tilt_deg >= _TILT_DEG))
    text = f"the board was tilted by {low:.0f} to {high:.0f} deg"
    if tilted < _TILTED_VIEWS:
        message = (
            f"{text}, {tilted} of {len(spread.tilt_deg)} views by {_TILT_DEG:.0f} deg or more: take views tilted by"
        )
        return Check("tilt-range", "warn", f"{message} 30 to 45 deg in several directions", high)
    if spread.weakest_tilt_deg < _LEAST_DIRECTION_DEG:
        message = f"{text}, all in one direction: take views with the board tilted {spread.weakest_axis} as well"
        return Check("tilt-range", "warn", message, high)
    return Check("tilt-range", "ok", text, high)


def _distance_check(spread: Spread) -> Check:
    low, high = float(spread.distance.min()), float(spread.distance.max())
    text = f"the board stood {1e3 * low:.0f} to {1e3 * high:.0f} mm from the camera"
    ratio = high / low if low > 0 else float("inf")
    if ratio < _LEAST_DISTANCE_RATIO:
        message = f"{text}, all views from about the same distance: take some nearer and some farther"
        return Check("distance-range", "warn", message, ratio)
    return Check("distance-range", "ok", text, ratio)


def _emptiest_side(counts: NDArray[np.int64]) -> str:
    """The half of the image with the fewest occupied cells."""
    seen = counts > 0
    rows, columns = seen.shape
    sides = {
        "left half": seen[:, : columns // 2],
        "right half": seen[:, -(columns // 2) :],
        "upper half": seen[: rows // 2],
        "lower half": seen[-(rows // 2) :],
    }
    return min(sides, key=lambda name: float(sides[name].mean()))
