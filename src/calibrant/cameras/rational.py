"""Rational radial distortion with decentering: OpenCV's eight terms k1 k2 p1 p2 k3 k4 k5 k6.

    g = (1 + k1 r2 + k2 r2^2 + k3 r2^3) / (1 + k4 r2 + k5 r2^2 + k6 r2^3)
    x' = x g + 2 p1 x y + p2 (r2 + 2 x^2),  y' = y g + p1 (r2 + 2 y^2) + 2 p2 x y

Source: Claus and Fitzgibbon 2005, "A rational function lens distortion model"; OpenCV's CALIB_RATIONAL_MODEL.
"""

from __future__ import annotations

from typing import Any

from calibrant.cameras.perspective import Perspective


class Rational(Perspective):
    """Radial distortion as a ratio of two cubics in r^2, and p1 p2."""

    name: str = "rational"
    parameter_names: tuple[str, ...] = (
        *("fx", "fy", "cx", "cy"),
        *("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    )
    parameter_units: tuple[str, ...] = ("px",) * 4 + ("1",) * 8
    summary: str = "wide perspective lenses up to about 120 degrees"

    def rows(self) -> Any:
        from calibrant.cameras.kernels.rational_rows import rational

        return rational
