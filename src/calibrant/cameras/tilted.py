"""Thin prism distortion on a tilted sensor: OpenCV's fourteen terms, the last two being angles.

    (x'', y'', 1) ~ M(tx, ty) (x', y', 1),  u = fx x'' + cx,  v = fy y'' + cy

M is the homography from the plane across the axis to one turned by tx about x and then by ty about y
(`plane_distortion.tilt`). For Scheimpflug cameras. Source: Louhichi et al. 2007, "Self-calibration of Scheimpflug
cameras: an easy protocol"; OpenCV's CALIB_TILTED_MODEL.
"""

from __future__ import annotations

from typing import Any

from calibrant.cameras.perspective import Perspective


class Tilted(Perspective):
    """Radial, decentering and thin prism distortion and a tilted sensor."""

    name: str = "tilted"
    parameter_names: tuple[str, ...] = (
        *("fx", "fy", "cx", "cy"),
        *("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
        *("s1", "s2", "s3", "s4", "tx", "ty"),
    )
    parameter_units: tuple[str, ...] = ("px",) * 4 + ("1",) * 12 + ("rad",) * 2
    summary: str = "Scheimpflug cameras, whose sensor is tilted on purpose"

    def rows(self) -> Any:
        from calibrant.cameras.kernels.rational_rows import tilted

        return tilted
