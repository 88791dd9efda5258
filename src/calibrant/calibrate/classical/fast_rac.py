"""Fast calibration by the radial alignment constraint, from the target's axes (lecture 001, slides 65 to 67).

Slide 65 says what is saved, three fits of two unknowns for one of five and one of three, and slide 66 that mu, C_x and
C_y are known; the equations are not on the slides. They are read here as those of Tsai's method where one coordinate is
0, with the origin, the crossing of the plate's middle line and column, seen at (X_0, Y_0):

    origin        v3 = t_x / t_y = mu X_0 / Y_0
    x_w axis      [x_w Y, -x_w mu X] (v1, v4)^T = mu X - v3 Y
    y_w axis      [y_w Y, -y_w mu X] (v2, v5)^T = mu X - v3 Y
    all points    [x - X g, x r^2 - X g r_0^2] (f_x, k f_x)^T = X w,    the same with Y / mu and y,

the last with the origin's own equation, t_z = (f_x + k f_x r_0^2) g, in place of t_z, g = (X_0 t_x + Y_0 t_y / mu) /
(X_0^2 + Y_0^2 / mu^2). Each is a 2x2 system in closed form. The price is that one pixel carries two of the unknowns:
the origin's noise is not averaged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrant.calibrate.classical.alignment import (
    OFF_CENTRE,
    Alignment,
    agreeing_sign,
    block_scale,
    refuse_facing,
    rotation_of_block,
)
from calibrant.calibrate.classical.depth import Aligned, Depth, finished
from calibrant.calibrate.classical.linear import RANK, SIGMAS
from calibrant.calibrate.classical.points import (
    FLAT,
    ClassicalCalibration,
    checked_aspect,
    checked_pairs,
    image_centre,
)
from calibrant.calibrate.classical.refusals import NO_AXES, NOT_COPLANAR, T_Y_ZERO, UNDETERMINED, Degenerate
from calibrant.geometry.projective import apply_homography, homography

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LEAST_POINTS = 5
LEAST_ON_AXIS = 2


@dataclass(frozen=True, eq=False)
class Axes:
    """Which points (n,) are the target's origin and lie on its axes, the origin left out of both."""

    origin: int
    x: Mask
    y: Mask


def calibrate_fast_rac(
    points: ArrayLike,
    uv: ArrayLike,
    *,
    image_size: tuple[int, int],
    centre: ArrayLike | None = None,
    aspect: float = 1.0,
) -> ClassicalCalibration:
    """Focal length, slide 50's radial term and pose from one view of a plane by three fits of two unknowns.

    Args: points (n, 3) metres with z = 0, among them the origin and two more on the x_w and on the y_w axis; uv (n, 2)
    px; centre (2,) px and aspect as for Tsai's method. Returns a camera of the model `division`, and one pose.
    Raises: InputError for unusable arguments; Degenerate for too few or collinear points, points off the plane
    z = 0, axes that are not seen, t_y = 0, a plane that faces the camera, no positive focal length.
    """
    p, m = checked_pairs(points, uv, least=LEAST_POINTS, method="fast calibration by radial alignment")
    mu, middle = checked_aspect(aspect), image_centre(image_size, centre)
    size = float(np.linalg.norm(np.ptp(p, axis=0)))
    if np.abs(p[:, 2]).max() > FLAT * size:
        raise Degenerate(NOT_COPLANAR, "fast calibration takes points of the plane z = 0, where its axes lie")
    axes = find_axes(p[:, :2], tolerance=FLAT * size)
    image = m - middle
    alignment = _align(p[:, :2], image, axes, aspect=mu)

    def step_two(rows: Aligned) -> Depth:
        return _depth(rows, alignment, axes.origin)

    return finished(
        alignment,
        p,
        image,
        radial="division",
        centre=middle,
        image_size=image_size,
        mirrored=True,
        linear=step_two,
    )


def find_axes(xy: Array, *, tolerance: float) -> Axes:
    """Origin and axes among points (n, 2), metres, to within `tolerance`, metres. Raises: Degenerate."""
    near = np.abs(xy) <= tolerance
    origin = np.flatnonzero(near.all(axis=1))
    on_x, on_y = near[:, 1] & ~near[:, 0], near[:, 0] & ~near[:, 1]
    if len(origin) == 0 or min(on_x.sum(), on_y.sum()) < LEAST_ON_AXIS:
        raise Degenerate(
            NO_AXES,
            f"the target's origin is {'seen' if len(origin) else 'not seen'}, with {on_x.sum()} points on its x axis "
            f"and {on_y.sum()} on its y axis; fast calibration needs the origin and {LEAST_ON_AXIS} points on each",
        )
    return Axes(int(origin[0]), on_x, on_y)


def _align(xy: Array, image: Array, axes: Axes, *, aspect: float) -> Alignment:
    """Step one (slides 65, 66), then slides 57 to 60 as in Tsai's method."""
    X, Y = aspect * image[:, 0], image[:, 1]
    noise = _noise_px(xy, image)
    X0, Y0 = X[axes.origin], Y[axes.origin]
    if abs(Y0) < max(OFF_CENTRE * float(np.ptp(image)), SIGMAS * noise):
        raise Degenerate(
            T_Y_ZERO,
            f"the target's origin is seen {abs(Y0):.2g} ± {noise:.2g} px from the principal point's row, and step one "
            "divides by that; move the camera or the target",
        )
    v3 = X0 / Y0
    columns, right = np.stack([Y, -X], axis=1), X - v3 * Y
    v1, v4 = _two_unknowns(columns[axes.x] * xy[axes.x, :1], right[axes.x])
    v2, v5 = _two_unknowns(columns[axes.y] * xy[axes.y, 1:], right[axes.y])
    block = np.array([[v1, v2], [v4, v5]])
    block = block * block_scale(block)
    lean = 1 - float(np.linalg.svd(block, compute_uv=False)[1])
    # A pixel of noise turns a point by its share of the distance from the origin, averaged over the axes.
    reach = float(np.sqrt(np.mean(np.sum((image - image[axes.origin])[axes.x | axes.y] ** 2, axis=1))))
    refuse_facing(lean, noise / reach / np.sqrt(np.sum(axes.x | axes.y)))
    t = block_scale(np.array([[v1, v2], [v4, v5]])) * np.array([v3, 1.0])
    x, y = (xy @ block.T + t).T
    sign = agreeing_sign(x, y, X, Y)
    return Alignment(rotation_of_block(sign * block), sign * t, aspect)


def _depth(rows: Aligned, alignment: Alignment, origin: int) -> Depth:
    """Step two with t_z eliminated by the origin's own equation; see the module."""
    o = rows.image[origin]
    g, r0 = float(o @ alignment.t) / float(o @ o), float(o @ o)
    r2 = np.sum(rows.image**2, axis=1)[:, None]
    columns = np.stack([(rows.xy - rows.image * g).ravel(), (rows.xy * r2 - rows.image * g * r0).ravel()], axis=1)
    fx, k_fx = _two_unknowns(columns, (rows.image * rows.w[:, None]).ravel())
    return Depth(fx, (fx + k_fx * r0) * g, k_fx * fx)


def _two_unknowns(columns: Array, right: Array) -> tuple[float, float]:
    """Least squares in two unknowns by Cramer's rule on scaled normal equations (n, 2). Raises: Degenerate."""
    length = np.sqrt(np.sum(columns**2, axis=0))
    a, b = (columns / np.where(length > 0, length, 1.0)).T
    cross = float(a @ b)
    det = float(a @ a) * float(b @ b) - cross * cross
    if not det > RANK:
        raise Degenerate(
            UNDETERMINED,
            "an axis of the target points at the principal point, or its points are seen as one: two of its unknowns "
            "cannot be told apart; turn the target",
        )
    p, q = float(a @ right), float(b @ right)
    return (
        float(((b @ b) * p - cross * q) / det / length[0]),
        float(((a @ a) * q - cross * p) / det / length[1]),
    )


def _noise_px(xy: Array, image: Array) -> float:
    """Noise of a pixel per axis as far as a homography leaves it; the lens's distortion counts as noise."""
    spare = 2 * len(xy) - 8
    if spare <= 0:
        return 0.0
    error = apply_homography(homography(xy, image), xy) - image
    return float(np.sqrt(np.sum(error**2) / spare))
