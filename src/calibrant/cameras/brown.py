"""Brown's model with five terms, in OpenCV's forward form and order: k1 k2 p1 p2 k3.

    x = X/Z, y = Y/Z, r2 = x^2 + y^2, g = 1 + k1 r2 + k2 r2^2 + k3 r2^3
    x' = x g + 2 p1 x y + p2 (r2 + 2 x^2),  y' = y g + p1 (r2 + 2 y^2) + 2 p2 x y
    u = fx x' + cx,  v = fy y' + cy

The forward map distorts ideal coordinates. Document 003's equations 2.7 and 2.8 map the other way and swap p1 and p2;
its files are in OpenCV's order, which is read here. Source: Brown 1966, "Decentering distortion of lenses".
"""

from __future__ import annotations

from typing import Any

from calibrant.cameras.perspective import Perspective


class Brown(Perspective):
    """Radial (k1 k2 k3) and tangential (p1 p2) distortion, OpenCV's order."""

    name: str = "brown"
    parameter_names: tuple[str, ...] = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
    parameter_units: tuple[str, ...] = ("px",) * 4 + ("1",) * 5
    summary: str = "ordinary lenses up to about 90 degrees of view"

    def rows(self) -> Any:
        from calibrant.cameras.kernels.brown_rows import rows

        return rows

    def rays(self) -> Any:
        from calibrant.cameras.kernels.brown_rays import rays

        return rays
