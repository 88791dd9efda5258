"""Rational distortion with thin prism terms: OpenCV's twelve, k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4.

    x' = x g + 2 p1 x y + p2 (r2 + 2 x^2) + s1 r2 + s2 r2^2
    y' = y g + p1 (r2 + 2 y^2) + 2 p2 x y + s3 r2 + s4 r2^2

The lecture (document 001, slides 40 to 45) names the three kinds of Weng, Cohen and Herniou 1992, "Camera calibration
with distortion models and accuracy evaluation", u' = u + D_u, v' = v + D_v with

    radial       D_u = k u (u^2 + v^2)                    D_v = k v (u^2 + v^2)
    decentering  D_u = p1 (3 u^2 + v^2) + 2 p2 u v        D_v = 2 p1 u v + p2 (u^2 + 3 v^2)
    thin prism   D_u = s1 (u^2 + v^2)                     D_v = s2 (u^2 + v^2)

Weng's k, p1, p2, s1, s2 are k1, p2, p1, s1, s3 here. Both decentering and thin prism distortion are radial and
tangential. Weng's model is this one with k2 ... k6, s2, s4 held at 0.
"""

from __future__ import annotations

from typing import Any

from calibrant.cameras.perspective import Perspective


class ThinPrism(Perspective):
    """Radial, decentering and thin prism distortion."""

    name: str = "thin_prism"
    parameter_names: tuple[str, ...] = (
        *("fx", "fy", "cx", "cy"),
        *("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
        *("s1", "s2", "s3", "s4"),
    )
    parameter_units: tuple[str, ...] = ("px",) * 4 + ("1",) * 12
    summary: str = "rational, and lens elements or sensors slightly askew"

    def rows(self) -> Any:
        from calibrant.cameras.kernels.rational_rows import thin_prism

        return thin_prism
