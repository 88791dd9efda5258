"""Step two of Tsai's method: t_z, f_x and the radial term, once R, t_x and t_y are known (lecture 001, slides 62, 63).

With (x, y) the camera coordinates of step one and w = r7 x_w + r8 y_w + r9 z_w, so that z = w + t_z, slide 50's lens

    X / (1 + k r^2) = f_x x / (w + t_z)    gives    [-X, x, x r^2] (t_z, f_x, k f_x)^T = X w,

linear in three unknowns, and the same with Y and mu y. Where w = 0 for all points, a plane that faces the camera, the
right side is 0 and only ratios can be had. The other two lens models of the slides are not linear; they start from this
solution and take Gauss-Newton steps in the same three unknowns, R, t_x and t_y being held as on the slides.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.classical.alignment import Alignment
from calibrant.calibrate.classical.linear import least_squares
from calibrant.calibrate.classical.points import ClassicalCalibration
from calibrant.calibrate.classical.radial import RadialModel, radial_camera
from calibrant.calibrate.classical.refusals import BEHIND, NO_FOCAL_LENGTH, Degenerate
from calibrant.geometry import se3

STEPS = 50
"""From the linear start five steps settle ordinary lenses."""
STOP = 1e-13
"""A step that moves the pixels by less than this share of their distance from the principal point is rounding."""
GAIN = 1e-14
"""A step that lowers the squared error by less than this share of it cannot be told from rounding."""


@dataclass(frozen=True, eq=False)
class Aligned:
    """What step one leaves to step two, a row a point.

    xy (n, 2): (x, y), metres; w (n,): z - t_z, metres; image (n, 2): (X, Y / mu) px, so that both axes have f_x.
    """

    xy: Array
    w: Array
    image: Array


@dataclass(frozen=True)
class Depth:
    """f_x px, t_z metres, and the model's radial term (dimensionless)."""

    fx: float
    t_z: float
    term: float


def aligned(alignment: Alignment, points: Array, image: Array) -> Aligned:
    """Points (n, 3), metres, and pixels from the principal point (n, 2) in the axes of step one."""
    p = points @ alignment.R.T
    return Aligned(p[:, :2] + alignment.t, p[:, 2], image / [1.0, alignment.aspect])


def linear_depth(rows: Aligned, *, radial: bool) -> Depth:
    """t_z, f_x and l1 = k f_y^2 of slide 50's lens by linear least squares (slides 62, 63); k = 0 unless `radial`.

    With Y / mu for Y, r^2 / mu^2 is the squared length of the pixel, and k f_x r^2 is the term over f_x times it.
    """
    columns = [-rows.image.ravel(), rows.xy.ravel()]
    if radial:
        columns.append((rows.xy * np.sum(rows.image**2, axis=1)[:, None]).ravel())
    found = least_squares(np.stack(columns, axis=1), (rows.image * rows.w[:, None]).ravel())
    t_z, fx = float(found[0]), float(found[1])
    return Depth(fx, t_z, float(found[2]) * fx if radial else 0.0)


def finished(
    alignment: Alignment,
    points: Array,
    image: Array,
    *,
    radial: RadialModel,
    centre: Array,
    image_size: tuple[int, int],
    mirrored: bool,
    linear: Callable[[Aligned], Depth] | None = None,
) -> ClassicalCalibration:
    """Step two, and the camera that both steps give.

    mirrored: whether step one left the sign of r3, r6, r7, r8 open; a negative f_x then decides for the other one
    (slide 60), with which t_z, f_x and k f_x change their sign and nothing else does.
    linear: `linear_depth` when not given.
    Raises: Degenerate where no sign gives a positive focal length with the points in front of the camera.
    """
    R = alignment.R
    rows = aligned(alignment, points, image)
    found = linear_depth(rows, radial=radial != "pinhole") if linear is None else linear(rows)
    if found.fx < 0 and mirrored:
        R = R * np.array([[1, 1, -1], [1, 1, -1], [-1, -1, 1]])
        rows = Aligned(rows.xy, -rows.w, rows.image)
        found = Depth(-found.fx, -found.t_z, found.term)
    _refuse_behind(found, rows)
    if radial in ("inverse_brown", "brown"):
        found = _refined_depth(found, rows, distorts=radial == "brown")
        _refuse_behind(found, rows)
    camera = radial_camera(
        radial, fx=found.fx, aspect=alignment.aspect, term=found.term, centre=centre, image_size=image_size
    )
    return ClassicalCalibration(camera, se3.make(R, [*alignment.t, found.t_z])[None])


def _refuse_behind(found: Depth, rows: Aligned) -> None:
    if not found.fx > 0:
        raise Degenerate(
            NO_FOCAL_LENGTH,
            f"step two gives f_x = {found.fx:.4g} px: the points do not fit a camera with this principal point and "
            "aspect; check them, and that points and pixels are in the same order. A plane that nearly faces the "
            "camera gives this too: tilt it",
        )
    behind = int(np.sum(rows.w + found.t_z <= 0))
    if behind:
        raise Degenerate(
            BEHIND,
            f"the camera that fits best has {behind} of {len(rows.w)} points behind it; check that points and pixels "
            "are in the same order and that the picture is not mirrored",
        )


def _refined_depth(start: Depth, rows: Aligned, *, distorts: bool) -> Depth:
    """(f_x, t_z, term) with the least squared error in pixels, by Gauss-Newton with halved steps where one is too long.

    distorts: slide 47, residuals of seen pixels; else slide 49, residuals of undistorted pixels.
    """
    residuals = _brown if distorts else _inverse_brown
    # Their k1 undoes, or does, what the division model's l1 does: of opposite sign for inverse_brown.
    x = np.array([start.fx, start.t_z, start.term if distorts else -start.term])
    r, J = residuals(x, rows)
    for _ in range(STEPS):
        step = -least_squares(J, r)
        moved = float(np.linalg.norm(J @ step))
        if moved <= STOP * np.linalg.norm(rows.image) or moved**2 <= GAIN * (r @ r):
            break
        for _ in range(STEPS):
            trial, slope = residuals(x + step, rows)
            if np.all(np.isfinite(trial)) and trial @ trial <= r @ r:
                break
            step = 0.5 * step
        else:
            break
        x, r, J = x + step, trial, slope
    return Depth(*(float(v) for v in x))


def _brown(x: Array, rows: Aligned) -> tuple[Array, Array]:
    """f m (1 + k |m|^2) - X with m = (x, y) / z, and its derivatives by f, t_z, k."""
    f, t_z, k = x
    iz = 1 / (rows.w + t_z)
    m = rows.xy * iz[:, None]
    s = np.sum(m * m, axis=1)[:, None]
    seen = m * (1 + k * s)
    by_z = -f * m * (1 + 3 * k * s) * iz[:, None]
    J = np.stack([seen.ravel(), by_z.ravel(), (f * m * s).ravel()], axis=1)
    return (f * seen - rows.image).ravel(), J


def _inverse_brown(x: Array, rows: Aligned) -> tuple[Array, Array]:
    """f m - X (1 + k |X / f|^2) and its derivatives by f, t_z, k."""
    f, t_z, k = x
    iz = 1 / (rows.w + t_z)
    m = rows.xy * iz[:, None]
    s = np.sum((rows.image / f) ** 2, axis=1)[:, None]
    r = f * m - rows.image * (1 + k * s)
    by_f = m + 2 * k * rows.image * s / f
    by_z = -f * m * iz[:, None]
    return r.ravel(), np.stack([by_f.ravel(), by_z.ravel(), (-rows.image * s).ravel()], axis=1)
