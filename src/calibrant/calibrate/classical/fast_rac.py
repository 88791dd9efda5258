"""Fast calibration by the radial alignment constraint, from the target's axes (lecture 001, slides 65 to 67).

Slide 65 says what is saved, three fits of two unknowns for one of five and one of three, and slide 66 that mu, C_x and
C_y are known; the equations are not on the slides. They are read here as those of Tsai's method where one coordinate is
0, with the origin, the crossing of the plate's middle line and column, seen at (X_0, Y_0):

    origin        v3 = t_x / t_y = mu X_0 / Y_0
    x_w axis      [x_w Y, -x_w mu X] (v1, v4)^T = mu X - v3 Y
    y_w axis      [y_w Y, -y_w mu X] (v2, v5)^T = mu X - v3 Y
    all points    [x - X g, x r^2 - X g r_0^2] (f_x, k f_x)^T = X w,    the same with Y / mu and y,

the last with the origin's own equation, t_z = (f_x + k f_x r_0^2) g, in place of t_z, g = (X_0 t_x + Y_0 t_y / mu) /
(X_0^2 + Y_0^2 / mu^2). Each is solved in closed form. The price is that one pixel carries two of the unknowns:
the origin's noise is not averaged.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array, Mask
from calibrant.calibrate.classical.alignment import (
    OFF_CENTRE,
    Alignment,
    agreeing_sign,
    block_scale,
    lean_of,
    refuse_facing,
    rotation_of_block,
)
from calibrant.calibrate.classical.depth import Aligned, Depth, finished
from calibrant.calibrate.classical.linear import RANK, SIGMAS
from calibrant.calibrate.classical.points import (
    FLAT,
    ClassicalCalibration,
    assumed,
    checked_aspect,
    checked_pairs,
    image_centre,
)
from calibrant.calibrate.classical.refusals import NO_AXES, NOT_COPLANAR, T_Y_ZERO, UNDETERMINED, Degenerate

LEAST_POINTS = 5
LEAST_ON_AXIS = 2


@dataclass(frozen=True, eq=False)
class Axes:
    """Which points (n,) are the target's origin and lie on its axes, the origin left out of both."""

    origin: int
    x: Mask
    y: Mask


@dataclass(frozen=True, eq=False)
class AxisFit:
    """(v1, v4) or (v2, v5) from one axis, with what its pixels' noise leaves of it.

    v (2,); covariance (2, 2) for pixels of 1 sigma = 1; by_v3 (2,), the derivative by v3; misfit, the sum of squared
    residuals in pixels, of `spare` equations more than unknowns. A radial lens adds nothing to it.
    """

    v: Array
    covariance: Array
    by_v3: Array
    misfit: float
    spare: int


def calibrate_fast_rac(
    points: ArrayLike,
    uv: ArrayLike,
    *,
    image_size: tuple[int, int],
    centre: ArrayLike | None = None,
    aspect: float | None = None,
) -> ClassicalCalibration:
    """Focal length, slide 50's radial term and pose from one view of a plane by three fits of two unknowns.

    Args: points (n, 3) metres with z = 0, among them the origin and two more on the x_w and on the y_w axis; uv (n, 2)
    px; centre (2,) px and aspect as for Tsai's method. Returns a camera of the model `division`, one pose, and what was
    taken as known without being given (`assumed`).
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
        return _depth_of_rows(rows, alignment, axes.origin)

    found = finished(
        alignment,
        p,
        image,
        radial="division",
        centre=middle,
        image_size=image_size,
        mirrored=True,
        linear=step_two,
    )
    return replace(found, assumed=assumed(middle, centre, aspect=aspect, takes_aspect=True))


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
    X0, Y0 = X[axes.origin], Y[axes.origin]
    _refuse_on_row(Y0, OFF_CENTRE * float(np.ptp(image)))
    v3 = X0 / Y0
    first = _axis_fit(xy[axes.x, 0], X[axes.x], Y[axes.x], v3)
    second = _axis_fit(xy[axes.y, 1], X[axes.y], Y[axes.y], v3)
    spare = first.spare + second.spare
    noise = np.sqrt((first.misfit + second.misfit) / spare) if spare > 0 else 0.0
    _refuse_on_row(Y0, SIGMAS * noise)
    block = np.stack([first.v, second.v], axis=1)
    common = np.concatenate([first.by_v3, second.by_v3]) * np.hypot(1, v3) / abs(Y0)
    covariance = np.outer(common, common)
    covariance[:2, :2] += first.covariance
    covariance[2:, 2:] += second.covariance
    by_rows = np.ix_([0, 2, 1, 3], [0, 2, 1, 3])
    refuse_facing(*lean_of(block, noise**2 * covariance[by_rows]))
    block, t = block * block_scale(block), block_scale(block) * np.array([v3, 1.0])
    x, y = (xy @ block.T + t).T
    sign = agreeing_sign(x, y, X, Y)
    return Alignment(rotation_of_block(sign * block), sign * t, aspect)


def _depth_of_rows(rows: Aligned, alignment: Alignment, origin: int) -> Depth:
    """Step two with t_z eliminated by the origin's own equation; see the module."""
    o = rows.image[origin]
    g, r0 = float(o @ alignment.t) / float(o @ o), float(o @ o)
    r2 = np.sum(rows.image**2, axis=1)[:, None]
    columns = np.stack([(rows.xy - rows.image * g).ravel(), (rows.xy * r2 - rows.image * g * r0).ravel()], axis=1)
    fx, k_fx = _two_unknowns(columns, (rows.image * rows.w[:, None]).ravel())
    return Depth(fx, (fx + k_fx * r0) * g, k_fx * fx)


def _refuse_on_row(Y0: float, least: float) -> None:
    if abs(Y0) <= least:
        raise Degenerate(
            T_Y_ZERO,
            f"the target's origin is seen {abs(Y0):.2g} px from the principal point's row, which its pixel does not "
            f"tell from 0 (less than {least:.2g} px), and step one divides by that; move the camera or the target",
        )


def _axis_fit(along: Array, X: Array, Y: Array, v3: float) -> AxisFit:
    """The fit of one axis. A pixel's error moves its equation by (1 + along v4) dX - (v3 + along v1) dY."""
    columns, right = along[:, None] * np.stack([Y, -X], axis=1), X - v3 * Y
    v = np.array(_two_unknowns(columns, right))
    by_pixel = np.hypot(1 + along * v[1], v3 + along * v[0])
    inverse = np.linalg.pinv(columns)
    noisy = inverse * by_pixel
    misfit = float(np.sum(((columns @ v - right) / by_pixel) ** 2))
    return AxisFit(v, noisy @ noisy.T, -inverse @ Y, misfit, len(along) - 2)


def _two_unknowns(columns: Array, right: Array) -> tuple[float, float]:
    """Least squares in two unknowns, columns (n, 2): the second column is made orthogonal to the first (closed form).

    Raises: Degenerate where the columns are parallel.
    """
    length = np.linalg.norm(columns, axis=0)
    a, b = (columns / np.where(length > 0, length, 1.0)).T
    cross, along = float(a @ b), float(a @ right)
    across = b - cross * a
    if not np.linalg.norm(across) > RANK:
        raise Degenerate(
            UNDETERMINED,
            "an axis of the target points at the principal point, or its points are seen as one: two of its unknowns "
            "cannot be told apart; turn the target",
        )
    second = float(across @ (right - along * a) / (across @ across))
    return (along - cross * second) / float(length[0]), second / float(length[1])
