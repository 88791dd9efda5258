"""Compiled inverse of Kannala and Brandt's model; see `kernels` for the contract and `kannala_brandt`.

Apart from the rows: a calibration does not ask for it, and code for several threads takes its time to load.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from calibrant.cameras.kernels.contract import FAST, RAYS_ARGUMENTS
from calibrant.compiled import compiled

_BLOCK = 256
"""Pixels solved together: their scratch rows stay in the first-level cache."""
_TABLE = 1024
"""Entries of the first guess: linear between them it is good to 1e-5, two Newton steps from rounding."""


@njit(cache=True, nogil=True, error_model="numpy")
def _angle_table(k1, k2, k3, k4, limit, largest):  # type: ignore[no-untyped-def]
    """theta over theta_d from 0 to `largest`, (_TABLE + 1,), `limit` where theta_d never gets there."""
    table = np.empty(_TABLE + 1)
    for j in range(_TABLE + 1):
        rd = largest * j / _TABLE
        low, high = 0.0, limit
        theta = min(rd, limit)
        for _ in range(60):
            t = theta * theta
            error = theta * (1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4)))) - rd
            if error < 0.0:
                low = theta
            else:
                high = theta
            trial = theta - error / (1.0 + t * (3.0 * k1 + t * (5.0 * k2 + t * (7.0 * k3 + t * 9.0 * k4))))
            if not (trial >= low and trial <= high):
                trial = 0.5 * (low + high)
            if abs(trial - theta) < 1e-14:
                break
            theta = trial
        table[j] = theta
    return table


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy", inline="always")
def _sine_cosine(m, theta, sine, cosine):  # type: ignore[no-untyped-def]
    """Sine and cosine of angles in [0, pi]: Taylor series of a = (theta - pi/2)/2, |a| <= pi/4, then doubled.

    sin theta = cos 2a = 1 - 2 sin^2 a, cos theta = -sin 2a. The first term left out is below 5e-17; unlike the C
    library's functions this vectorises.
    """
    for i in range(m):
        a = 0.5 * theta[i] - 0.25 * np.pi
        q = a * a
        s = 1.0 - q / 72.0 * (1.0 - q / 110.0 * (1.0 - q / 156.0 * (1.0 - q / 210.0)))
        s = a * (1.0 - q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0 * s)))
        c = 1.0 - q / 56.0 * (1.0 - q / 90.0 * (1.0 - q / 132.0 * (1.0 - q / 182.0 * (1.0 - q / 240.0))))
        c = 1.0 - q / 2.0 * (1.0 - q / 12.0 * (1.0 - q / 30.0 * c))
        sine[i], cosine[i] = 1.0 - 2.0 * s * s, -2.0 * s * c


@compiled(RAYS_ARGUMENTS, fastmath=FAST, parallel=True)
def rays(parameters, limit, uv, out):  # type: ignore[no-untyped-def]
    """Unit rays of pixels: theta from a table and Newton steps without branches, so that the loop vectorises."""
    cx, cy = parameters[2], parameters[3]
    k1, k2, k3, k4 = parameters[4], parameters[5], parameters[6], parameters[7]
    n = uv.shape[0]
    ifx, ify = 1.0 / parameters[0], 1.0 / parameters[1]
    largest = 1e-12
    for i in range(n):
        a, b = (uv[i, 0] - cx) * ifx, (uv[i, 1] - cy) * ify
        s = a * a + b * b
        largest = s if s > largest else largest
    largest = np.sqrt(largest)
    table, per_step = _angle_table(k1, k2, k3, k4, limit, largest), _TABLE / largest
    lost = 0
    for block in prange((n + _BLOCK - 1) // _BLOCK):
        first = block * _BLOCK
        m = min(_BLOCK, n - first)
        w = np.empty((5, _BLOCK))
        rd, theta, sine, cosine, good = w[0], w[1], w[2], w[3], w[4]
        for i in range(m):
            a, b = (uv[first + i, 0] - cx) * ifx, (uv[first + i, 1] - cy) * ify
            rd[i] = np.sqrt(a * a + b * b)
            at = min(rd[i] * per_step, _TABLE - 1e-9)
            j = int(at)
            theta[i] = table[j] + (at - j) * (table[j + 1] - table[j])
        for _ in range(10):
            moved = 0.0
            for i in range(m):
                t = theta[i] * theta[i]
                error = theta[i] * (1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4)))) - rd[i]
                slope = 1.0 + t * (3.0 * k1 + t * (5.0 * k2 + t * (7.0 * k3 + t * 9.0 * k4)))
                step = error / slope
                good[i] = 1.0 if (slope > 0.0 and step * step < 1e-14 and theta[i] < limit) else 0.0
                theta[i] -= step
                moved += step * step
            if moved < 1e-14:
                break
        _sine_cosine(m, theta, sine, cosine)
        for i in range(m):
            ok = good[i] > 0.0
            lost += 0 if ok else 1
            s = sine[i] / max(rd[i], 1e-300) if ok else np.nan
            a, b = (uv[first + i, 0] - cx) * ifx, (uv[first + i, 1] - cy) * ify
            out[first + i, 0], out[first + i, 1], out[first + i, 2] = s * a, s * b, cosine[i] if ok else np.nan
    return lost
