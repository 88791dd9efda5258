"""Scaramuzza's polynomial lens, OCamCalib's and CamOdoCal's: read as the nearest camera, and said by how much.

    (p, q) = A (x, y) + centre,  rho = |(x, y)|,  ray = (x, y, a0 + a1 rho + a2 rho^2 + ...)

The polynomial's side that the image's middle looks to is ahead. Source: Scaramuzza, Martinelli and Siegwart 2006, "A
toolbox for easily calibrating omnidirectional cameras"; OCamCalib's undistortFunctions (cam2world).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import Size
from calibrant.formats.cameras.foreign_lens import nearest_by_rays


def polynomial_camera(
    coefficients: Array, A: Array, centre: Array, *, size: Size, source: str, answers: Mapping[str, str]
) -> Camera:
    """The nearest camera to a polynomial lens: coefficients a0, a1, …; A (2, 2) and centre (2,) in pixels (u, v).

    Raises: InputError for a polynomial that is none, or an A without an inverse.
    """
    if len(coefficients) == 0 or coefficients[0] == 0 or abs(np.linalg.det(A)) < 1e-6:
        raise InputError(f"{source}: a polynomial {coefficients.tolist()} with affine terms {A.ravel().tolist()}")
    ahead = np.sign(coefficients[0])

    def rays(uv: Array) -> Array:
        xy = np.linalg.solve(A, (uv - centre).T).T
        rho = np.linalg.norm(xy, axis=-1)
        return np.concatenate([xy, ahead * np.polyval(coefficients[::-1], rho)[:, None]], axis=1)

    return nearest_by_rays(
        rays,
        size,
        answers,
        focal_px=float(abs(coefficients[0])),
        centre=centre,
        what=f"{source}: a polynomial (Scaramuzza's) lens",
    )
