"""Terms of distortion that pictures may not tell, held near nothing by what lenses can do.

Few views, or a long focal length, leave higher terms at the mercy of the noise: k3 of -68 fits as well as none. No lens
moves the corner of its picture by more than a part of its distance from the axis, and each further term of the series
by less than the one before. That is a prior of mean 0 and

    sigma(k_i) r^(2i) = share_i,     3 sigma(p) r = share,

r the corner's distance from the axis over the focal length. Where the views tell a term, the prior changes nothing.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera

RADIAL = {"k1": (2, 0.1), "k2": (4, 0.03), "k3": (6, 0.01)}
"""Power of r and share of one sigma. Lenses that are no fisheyes bend the corners of their pictures by 1 to 10 per
cent; a series that is of use there falls to a third, or faster, from term to term."""
DECENTRING_SHARE = 0.01
"""Lens elements are centred to a hundredth of their size: an order below what they bend."""


def weak_terms_information(camera: Camera) -> Array:
    """Square root information (d, k) of the prior on a camera's distortion; (0, k) for models without such terms."""
    names, r = camera.model.parameter_names, corner_reach(camera)
    rows = []
    for j, name in enumerate(names):
        sigma = term_sigma(name, r)
        if sigma is not None:
            row = np.zeros(len(names))
            row[j] = 1 / sigma
            rows.append(row)
    return np.array(rows).reshape(-1, len(names))


def term_sigma(name: str, reach: float) -> float | None:
    """What a term can be, one sigma, where the corner is at `reach`; None for a parameter that has no such bound."""
    if name in RADIAL:
        power, share = RADIAL[name]
        return share / reach**power
    if name in ("p1", "p2"):
        return DECENTRING_SHARE / (3 * reach)
    return None


def corner_reach(camera: Camera) -> float:
    """Distance of the picture's farthest corner from the axis, in focal lengths."""
    width, height = camera.image_size
    p = camera.parameters
    x = max(abs(-0.5 - p["cx"]), abs(width - 0.5 - p["cx"])) / p["fx"]
    y = max(abs(-0.5 - p["cy"]), abs(height - 0.5 - p["cy"])) / p["fy"]
    return float(np.hypot(x, y))
