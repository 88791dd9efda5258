"""Step one of Tsai's method: R, t_x and t_y from the radial alignment constraint (lecture 001, slides 51 and 54 to 61).

A lens that is turned about its axis moves a point along its radius, whatever its distortion and focal length. With (X,
Y) pixels from the principal point, mu = f_y / f_x and (x, y) the camera coordinates of a point (slide 51),

    mu X : Y = x : y,    x = r1 x_w + r2 y_w + r3 z_w + t_x,    y = r4 x_w + r5 y_w + r6 z_w + t_y,

linear in (r1 r2 r3 t_x r4 r5 r6 t_y) up to their scale. Coplanar points have z_w = 0 (slides 54 and 55); points
with depth tell mu as well (Tsai 1987, "A versatile camera calibration technique", its form for points not coplanar).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.classical.linear import SIGMAS, NullVector, least_squares, null_vector
from calibrant.calibrate.classical.refusals import FRONTO_PARALLEL, T_X_ZERO, T_Y_ZERO, UNDETERMINED, Degenerate
from calibrant.errors import InputError
from calibrant.geometry import so3

Scale = Literal["t_y", "t_x", "norm"]

OFF_CENTRE = 1e-6
"""t_y over the target's size below which it is 0: the origin's image is then nearer to the principal point's row than
any camera resolves, and dividing by t_y costs six digits."""
FACING = 1e-8
"""1 - cos of the tilt below which a plane faces the camera: 0.008 degrees, flatter than targets are made."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """R (3, 3), t_x and t_y (2,) metres, and mu = f_y / f_x.

    Of coplanar points the sign of r3, r6, r7, r8 is open until step two knows the sign of f_x (slide 60).
    """

    R: Array
    t: Array
    aspect: float


def align_coplanar(xy: Array, image: Array, *, aspect: float, scale: Scale) -> Alignment:
    """R, t_x, t_y of coplanar points: xy (n, 2) metres in their plane, image (n, 2) px from the principal point.

    Slide 55, with v = (r1, r2, t_x, r4, r5) / t_y:    [x_w Y, y_w Y, Y, -x_w mu X, -y_w mu X] v = mu X
    scale: what the unknowns are divided by: "t_y"; "t_x", where t_y = 0 (slide 56); "norm", the least |M v| with
    |v| = 1, which asks for neither.
    Raises: Degenerate for t_y = 0 (or t_x), a plane that faces the camera, points that leave a second solution.
    """
    x, y = xy.T
    X, Y = aspect * image[:, 0], image[:, 1]
    M = np.column_stack([x * Y, y * Y, Y, -x * X, -y * X, -X])
    found = _solved(M)
    block = found.values[[0, 1, 3, 4]].reshape(2, 2)
    known = [0, 1, 3, 4]
    refuse_facing(*lean_of(block, found.covariance[np.ix_(known, known)]))
    h = _scaled_solution(found, M, scale, block_scale(block), _size_of_points(xy))
    h = h * block_scale(h[[0, 1, 3, 4]].reshape(2, 2))
    h = h * agreeing_sign(xy @ h[:2] + h[2], xy @ h[3:5] + h[5], X, Y)
    return Alignment(rotation_of_block(h[[0, 1, 3, 4]].reshape(2, 2)), h[[2, 5]], aspect)


def align(points: Array, image: Array, *, scale: Scale) -> Alignment:
    """R, t_x, t_y and mu of points with depth: points (n, 3) metres, image (n, 2) px from the principal point.

    With s = 1 / mu and v = (s r1, s r2, s r3, s t_x, r4, r5, r6) / t_y (Tsai 1987):
        [x_w Y, y_w Y, z_w Y, Y, -x_w X, -y_w X, -z_w X] v = X
        |t_y| = (v5^2 + v6^2 + v7^2)^(-1/2),    s = |t_y| (v1^2 + v2^2 + v3^2)^(1/2)
    Raises: Degenerate as `align_coplanar`, but that the points may face the camera.
    """
    X, Y = image[:, :1], image[:, 1:]
    M = np.hstack([points * Y, Y, -points * X, -X])
    found = _solved(M)
    h = _scaled_solution(found, M, scale, 1 / float(np.linalg.norm(found.values[4:7])), _size_of_points(points))
    h = h / np.linalg.norm(h[4:7])
    s = float(np.linalg.norm(h[:3]))
    h[:4] /= s
    h = h * agreeing_sign(points @ h[:3] + h[3], points @ h[4:7] + h[7], image[:, 0], image[:, 1])
    R = so3.nearest(np.stack([h[:3], h[4:7], np.cross(h[:3], h[4:7])]))
    return Alignment(R, h[[3, 7]], 1 / s)


def rotation_of_block(block: Array) -> Array:
    """A rotation from its upper left block ((r1, r2), (r4, r5)); r3 or r6 is taken positive (slide 60).

        r3 = (1 - r1^2 - r2^2)^(1/2),    r3 r6 = -(r1 r4 + r2 r5),    (r7 r8 r9) = (r1 r2 r3) x (r4 r5 r6)
    The second equation is that rows are orthogonal; it gives r6 the sign opposite to the slide's sign(r1 r4 + r2 r5) as
    the text has it. The larger of r3 and r6 is the root, the other follows from it, so that neither is a difference of
    equal numbers. Noise leaves rows that are not quite orthonormal: the nearest rotation is taken (slide 61).
    """
    first, second = block
    r3, r6 = (float(np.sqrt(max(1 - row @ row, 0.0))) for row in block)
    across = float(first @ second)
    if r3 >= r6:
        r6 = -across / r3 if r3 > 0 else 0.0
    else:
        r3 = -across / r6
    rows = np.array([[*first, r3], [*second, r6]])
    return so3.nearest(np.vstack([rows, np.cross(rows[0], rows[1])]))


def block_scale(block: Array) -> float:
    """|t_y| (or what else divides) from C = ((v1, v2), (v4, v5)), slide 57, in the form that loses no digits.

        t_y^2 = (S - (S^2 - 4 D^2)^(1/2)) / (2 D^2) = 2 / (S + (S^2 - 4 D^2)^(1/2)),    D = v1 v5 - v4 v2, S = sum v^2
    For D = 0, a zero row or column among others, the right side is the slide's other case, 1 / (v_i^2 + v_j^2). It says
    that the larger singular value of the block of a rotation is 1.
    """
    S, D = float(np.sum(block**2)), float(block[0, 0] * block[1, 1] - block[1, 0] * block[0, 1])
    return float(np.sqrt(2 / (S + np.sqrt(max(S * S - 4 * D * D, 0.0)))))


def _solved(M: Array) -> NullVector:
    found = null_vector(M)
    if not found.determined:
        raise Degenerate(
            UNDETERMINED,
            "the directions of the points from the principal point fit a second rotation as well; take more points, "
            "spread over the image",
        )
    return found


def _scaled_solution(found: NullVector, M: Array, scale: Scale, length: float, size: float) -> Array:
    """The unknowns with the one named by `scale` set to 1, by least squares in the others; refused where it is 0.

    length: metres of one unit of `found`; size: of the target, metres.
    """
    if scale not in get_args(Scale):
        raise InputError(f"scale is one of {', '.join(get_args(Scale))}, got {scale!r}")
    if scale == "norm":
        return np.array(found.values)
    k = M.shape[1]
    one, other, name = (k - 1, k // 2 - 1, T_Y_ZERO) if scale == "t_y" else (k // 2 - 1, k - 1, T_X_ZERO)
    value, sigma = length * abs(found.values[one]), length * found.sigma(one)
    if value < max(OFF_CENTRE * size, SIGMAS * sigma):
        axis, line = ("y", "row") if scale == "t_y" else ("x", "column")
        both = abs(found.values[other]) * length < max(OFF_CENTRE * size, SIGMAS * found.sigma(other))
        cure = (
            "t_x is 0 too: move the camera or the target (slide 56), or take scale='norm'"
            if both
            else f"divide by {'t_x' if scale == 't_y' else 't_y'} (slide 56) or by neither: scale='norm'"
        )
        raise Degenerate(
            name,
            f"the target's origin is seen on the principal point's {line}, t_{axis} = {1e3 * value:.2g} ± "
            f"{1e3 * sigma:.2g} mm, and step one divides by it; {cure}",
        )
    rest = [i for i in range(k) if i != one]
    h = np.ones(k)
    h[rest] = least_squares(M[:, rest], -M[:, one])
    return h


def lean_of(block: Array, covariance: Array) -> tuple[float, float]:
    """1 - cos of a plane's tilt, and its 1 sigma, from C = ((v1, v2), (v4, v5)) and the covariance (4, 4) of its rows.

    The block's singular values are 1 and cos of the tilt; their difference is the length of e = (v1 - v5, v2 + v4), or
    with v5, v4 negated for a plane seen from behind.
    """
    side = 1.0 if np.linalg.det(block) >= 0 else -1.0
    E = np.array([[1, 0, 0, -side], [0, 1, side, 0]])
    noise = np.linalg.eigvalsh(E @ covariance @ E.T)[-1]
    larger = 1 / block_scale(block)
    return float(np.linalg.norm(E @ block.ravel())) / larger, float(np.sqrt(max(noise, 0.0))) / larger


def refuse_facing(lean: float, sigma: float) -> None:
    """Raises: Degenerate for a plane whose `lean`, 1 - cos of its tilt, does not stand out of its 1 sigma."""
    least = max(FACING, SIGMAS * sigma)
    if lean < least:
        tilt, smallest = (float(np.rad2deg(np.arccos(1 - min(v, 1.0)))) for v in (lean, least))
        raise Degenerate(
            FRONTO_PARALLEL,
            f"a tilt of {tilt:.2g} degrees cannot be told from a plane that faces the camera (the points' noise hides "
            f"up to {smallest:.2g}), and then near with a short lens and far with a long one look the same. Tilt the "
            "target 20 to 45 degrees",
        )


def agreeing_sign(x: Array, y: Array, X: Array, Y: Array) -> float:
    """Sign of t_y: x and X, y and Y agree in sign (slides 58 and 59), asked of all points in place of one."""
    return 1.0 if float(x @ X + y @ Y) >= 0 else -1.0


def _size_of_points(points: Array) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=0)))
