"""How much more, or less, the misfits of a model move an estimate than noise of the same size would.

Least squares states V = s^2 (J^T J)^-1 with s^2 from the residuals r, if these are noise. They are not noise alone:
pixels, demosaicing and resizing make an edge's profile depend on where it falls between pixels, and models are
approximate. So the pixels are put into groups whose errors do not depend on each other; and with g_q the share of pixel
q in (x, y) per grey level, each group's sum of g_q r_q is compared with what noise would give there (K.-Y. Liang,
S. Zeger, Longitudinal data analysis using generalized linear models, Biometrika 1986). The ratio, over all places of a
picture since raster and blur are the same there, multiplies V: below 1 where misfits cancel within a group.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrant.compiled import compiled_part

GROUP_PX = 3.0
"""Length of edge whose errors are taken as one: pixels further apart do not share the raster's effect."""
LEAST_GROUPS = 150
"""Over all places: the ratio of variances is then known to a tenth, by two axes each. With fewer it is taken for 1."""


@compiled_part("void(float64[:, ::1], float64[::1], float64[:, ::1], int64[::1], int64, float64, float64[:, ::1])")
def sum_groups(J, r, cofactors, group, count, variance, sums):  # type: ignore[no-untyped-def]
    """Fills sums (2, 6) of the even groups and of the odd: over the groups, the squares of sums of g r in variances of
    (x, y); what noise gives; count; and their shares of the cofactors xx, xy, yy of (x, y).

    J (p, n), r (n,); cofactors (p, p): (J J^T)^-1, of which x and y are first; group (n,) below count; variance of r.
    """
    p, n = J.shape
    scale = cofactors[0, 0] + cofactors[1, 1]
    shares, taken = np.empty((2, n)), np.empty((count, p))
    shift, energy = np.empty(count), np.empty(count)
    for half in range(2):
        for i in range(6):
            sums[half, i] = 0.0
        sums[half, 2] = (count + 1 - half) // 2
    for axis in range(2):
        share = shares[axis]
        for k in range(n):
            share[k] = 0.0
        for i in range(p):
            for k in range(n):
                share[k] += cofactors[axis, i] * J[i, k]
        for part in range(count):
            shift[part], energy[part] = 0.0, 0.0
            for i in range(p):
                taken[part, i] = 0.0
        for k in range(n):
            shift[group[k]] += share[k] * r[k]
            energy[group[k]] += share[k] * share[k]
            for i in range(p):
                taken[group[k], i] += share[k] * J[i, k]
        for part in range(count):
            half = sums[part % 2]
            half[0] += shift[part] * shift[part] / (variance * scale)
            half[1] += energy[part] / scale
            half[3 + 2 * axis] += energy[part]
            # Residuals are noise less what the fit took of it: g^T (I - J C J^T) g within the group.
            for i in range(p):
                product = 0.0
                for j in range(p):
                    product += cofactors[i, j] * taken[part, j]
                half[1] -= taken[part, i] * product / scale
    for k in range(n):
        sums[group[k] % 2, 4] += shares[0, k] * shares[1, k]


def variance_ratio(sums: NDArray[np.float64]) -> float:
    """Of the misfits' effect over noise's, from the sums (n, …, 6) of the places of a picture."""
    found, expected, count = sums.reshape(-1, 6).sum(axis=0)[:3]
    return float(found / expected) if count >= LEAST_GROUPS else 1.0
