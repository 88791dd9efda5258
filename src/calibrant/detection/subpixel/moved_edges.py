"""Two crossing edges under a blur that is wider along one direction: what a picture taken on the move shows.

The blur of `saddle` is a Gaussian of covariance s^2 I. Here it is S = s^2 exp(A), A symmetric without trace,

    A = [[d, o], [o, -d]],   S = s^2 (cosh(rho) I + sinh(rho) / rho A),   rho^2 = d^2 + o^2,

so that the blur along the motion is s e^(rho / 2), across it s e^(-rho / 2), and d = o = 0 is the same to all sides.
An edge of unit normal n shows of it s_n^2 = n^T S n alone, and two edges a, b their correlation r = n_a^T S n_b /
(s_a s_b); with these in place of s and cos(a - b) the model is that of `saddle`. A camera that moves evenly while it
exposes smears by a box and no Gaussian; but that too is even about the corner, which it therefore does not pull aside.
"""

from __future__ import annotations

import math

import numpy as np

from calibrant.compiled import compiled_part
from calibrant.detection.subpixel.blurred_step import step_and_bell

SQRT_HALF = math.sqrt(0.5)
SMALL_RHO = 1e-4
"""Below it the series of sinh and cosh are exact to rounding after two terms."""


@compiled_part("UniTuple(float64, 2)(float64, float64, float64, float64, float64)")
def _times(xx, xy, yy, x, y):  # type: ignore[no-untyped-def]
    """The symmetric matrix times (x, y)."""
    return xx * x + xy * y, xy * x + yy * y


@compiled_part("void(float64[::1], float64[::1])")
def edges_of(p, shape):  # type: ignore[no-untyped-def]
    """Fills shape (13,) from p (13,) of `linearise_moved`: log s_a, log s_b, r; then the slopes of these three.

    Slopes of log s_a by its angle, d, o (3 4 5), of log s_b likewise (6 7 8), of r by both angles, d, o (9 10 11 12).
    """
    ca, sa, cb, sb = math.cos(p[2]), math.sin(p[2]), math.cos(p[3]), math.sin(p[3])
    d, o = p[11], p[12]
    rho = math.sqrt(d * d + o * o)
    if rho < SMALL_RHO:
        even, odd, bend = 1.0 + 0.5 * rho * rho, 1.0 + rho * rho / 6.0, 1.0 / 3.0 + rho * rho / 30.0
    else:
        even, odd = math.cosh(rho), math.sinh(rho) / rho
        bend = (even - odd) / (rho * rho)
    xx, yy, xy = even + odd * d, even - odd * d, odd * o
    # Slopes of the three by d and by o.
    dxx, dyy, dxy = odd * d + bend * d * d + odd, odd * d - bend * d * d - odd, bend * d * o
    oxx, oyy, oxy = odd * o + bend * o * d, odd * o - bend * o * d, bend * o * o + odd
    # Normals (-sin, cos), and their slopes by the angle, (-cos, -sin).
    a_x, a_y = _times(xx, xy, yy, -sa, ca)
    b_x, b_y = _times(xx, xy, yy, -sb, cb)
    va, vb, both = -sa * a_x + ca * a_y, -sb * b_x + cb * b_y, -sa * b_x + ca * b_y
    root = math.sqrt(va * vb)
    r = both / root
    shape[0], shape[1], shape[2] = p[4] + 0.5 * math.log(va), p[4] + 0.5 * math.log(vb), r
    shape[3] = (-ca * a_x - sa * a_y) / va
    shape[6] = (-cb * b_x - sb * b_y) / vb
    for i in range(2):
        qxx, qxy, qyy = (dxx, dxy, dyy) if i == 0 else (oxx, oxy, oyy)
        shape[4 + i] = 0.5 * (sa * sa * qxx - 2.0 * sa * ca * qxy + ca * ca * qyy) / va
        shape[7 + i] = 0.5 * (sb * sb * qxx - 2.0 * sb * cb * qxy + cb * cb * qyy) / vb
        across = sa * sb * qxx - (sa * cb + ca * sb) * qxy + ca * cb * qyy
        shape[11 + i] = across / root - r * (shape[4 + i] + shape[7 + i])
    shape[9] = (-ca * b_x - sa * b_y) / root - r * shape[3]
    shape[10] = (-cb * a_x - sb * a_y) / root - r * shape[6]


@compiled_part("float64(float64[:, ::1], float64[::1], float64[:, ::1], float64[::1])")
def linearise_moved(window, p, J, residuals):  # type: ignore[no-untyped-def]
    """Fills J (13, n) and residuals (n,) from the window's u, v and grey, (3, n); returns the sum of squared residuals.

    p (13,): the eleven of `saddle`, and d, o.
    """
    x, y, m, c, gx, gy = p[0], p[1], p[5], p[6], p[7], p[8]
    ca, sa, cb, sb = math.cos(p[2]), math.sin(p[2]), math.cos(p[3]), math.sin(p[3])
    shape = np.empty(13)
    edges_of(p, shape)
    per_a, per_b, r, slope = math.exp(-shape[0]), math.exp(-shape[1]), shape[2], math.sqrt(2.0 / math.pi)
    a_by_angle, a_by_d, a_by_o = shape[3], shape[4], shape[5]
    b_by_angle, b_by_d, b_by_o = shape[6], shape[7], shape[8]
    r_by_a, r_by_b, r_by_d, r_by_o = shape[9], shape[10], shape[11], shape[12]
    skew_of_a, skew_of_b = per_a * per_a * per_a / 6.0, per_b * per_b * per_b / 6.0
    total = 0.0
    for k in range(len(residuals)):
        dx, dy = window[0, k] - x, window[1, k] - y
        ta, tb = (ca * dy - sa * dx) * per_a, (cb * dy - sb * dx) * per_b
        ea, bell_a = step_and_bell(SQRT_HALF * ta)
        eb, bell_b = step_and_bell(SQRT_HALF * tb)
        ga, gb = slope * bell_a, slope * bell_b
        qa, qb = ta * ta - 1.0, tb * tb - 1.0
        both = ga * gb
        series = r + r * r * (0.5 * ta * tb + r / 6.0 * qa * qb)
        by_ka, by_kb = -c * skew_of_a * qa * ga * eb, -c * skew_of_b * qb * gb * ea
        crossed = ea * eb + both * series
        residual = window[2, k] - (m + gx * dx + gy * dy + c * crossed + p[9] * by_ka + p[10] * by_kb)
        residuals[k] = residual
        total += residual * residual
        wa = c * (ga * eb + both * (r * r * (0.5 * tb + r / 3.0 * ta * qb) - ta * series))
        wb = c * (gb * ea + both * (r * r * (0.5 * ta + r / 3.0 * tb * qa) - tb * series))
        by_r = c * both * (1.0 + r * (ta * tb + 0.5 * r * qa * qb))
        wider_a, wider_b = -wa * ta, -wb * tb
        wa, wb = wa * per_a, wb * per_b
        J[0, k] = wa * sa + wb * sb - gx
        J[1, k] = -wa * ca - wb * cb - gy
        J[2, k] = -wa * (ca * dx + sa * dy) + a_by_angle * wider_a + r_by_a * by_r
        J[3, k] = -wb * (cb * dx + sb * dy) + b_by_angle * wider_b + r_by_b * by_r
        J[4, k] = wider_a + wider_b
        J[5, k] = 1.0
        J[6, k] = crossed
        J[7, k] = dx
        J[8, k] = dy
        J[9, k] = by_ka
        J[10, k] = by_kb
        J[11, k] = a_by_d * wider_a + b_by_d * wider_b + r_by_d * by_r
        J[12, k] = a_by_o * wider_a + b_by_o * wider_b + r_by_o * by_r
    return total
