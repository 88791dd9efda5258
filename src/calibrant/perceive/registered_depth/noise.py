"""How noisy a depth camera is: constant in inverse depth, as disparities are, and shared by neighbouring pixels.

A stereo camera of focal length f, pixels, and baseline b, metres, whose disparities have the noise s, pixels, errs by

    sigma(1/z) = s / (f b),    sigma(z) = z^2 s / (f b)

(Intel 2019, "Best-known methods for tuning RealSense D400 depth cameras", section 2: s about 0.08 on texture).
Matching windows overlap, so that neighbours err alike: n pixels tell as much as n / `pixels_per_sample` independent
ones. A common factor of all depths, `scale_sigma`, is not lowered by any averaging.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError


@dataclass(frozen=True)
class DepthNoise:
    """inverse_sigma: of 1/z, 1/m; pixels_per_sample: pixels that tell as much as one independent one; scale_sigma: of a
    factor common to all depths, relative.

        >>> noise = DepthNoise.stereo(focal_px=617.0, baseline_m=0.05)
        >>> round(1e3 * float(noise.sigma_z(0.5)), 3)
        0.648
    """

    inverse_sigma: float
    pixels_per_sample: float = 1.0
    scale_sigma: float = 0.0

    def __post_init__(self) -> None:
        if not (self.inverse_sigma > 0 and self.pixels_per_sample >= 1 and self.scale_sigma >= 0):
            raise InputError(
                "noise of depth: sigma of 1/z above 0, pixels a sample at least 1 and sigma of the scale at least 0, "
                f"got {self.inverse_sigma:g}, {self.pixels_per_sample:g}, {self.scale_sigma:g}"
            )

    @classmethod
    def stereo(
        cls,
        *,
        focal_px: float,
        baseline_m: float,
        disparity_px: float = 0.08,
        pixels_per_sample: float = 1.0,
        scale_sigma: float = 0.0,
    ) -> DepthNoise:
        """Of a stereo depth camera, by its disparities' noise."""
        return cls(disparity_px / (focal_px * baseline_m), pixels_per_sample, scale_sigma)

    @property
    def effective(self) -> float:
        """sigma of 1/z that every pixel has where all are taken as independent: right for sums over many."""
        return self.inverse_sigma * self.pixels_per_sample**0.5

    def sigma_z(self, z: Array | float) -> Array:
        """1 sigma of a depth, metres: of one pixel, without the common scale."""
        return np.square(np.asarray(z, dtype=np.float64)) * self.inverse_sigma

    def with_level(self, inverse_sigma: float, pixels_per_sample: float) -> DepthNoise:
        """The same common scale with another noise."""
        return replace(self, inverse_sigma=inverse_sigma, pixels_per_sample=max(pixels_per_sample, 1.0))


D435 = DepthNoise.stereo(focal_px=617.0, baseline_m=0.050)
"""RealSense D435 at 640 x 480 (baseline 50 mm) on texture."""
D455 = DepthNoise.stereo(focal_px=617.0, baseline_m=0.095)
"""RealSense D455 (95 mm)."""
