"""How noisy a depth camera is: constant in inverse depth, as disparities are, and shared by neighbouring pixels.

A stereo camera of focal length f, pixels, and baseline b, metres, whose disparities have the noise s, pixels, errs by

    sigma(1/z) = s / (f b),    sigma(z) = z^2 s / (f b)

(Intel 2019, "Best-known methods for tuning RealSense D400 depth cameras", section 2: s about 0.08 on texture).
Matching windows overlap, so that neighbours err alike: n pixels tell as much as n / `pixels_per_sample` independent
ones. What all depths have in common is not lowered by any averaging: a factor, `scale_sigma`, and an offset of all
disparities, `offset_sigma`, which the camera's own calibration leaves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError

OFFSET_PX = 0.03
"""Of disparities, by the makers' calibration: 0.1 % of depth for a baseline of 95 mm at 1.3 m, where data sheets
promise 2 % at most."""


@dataclass(frozen=True)
class DepthNoise:
    """inverse_sigma: of 1/z, 1/m; pixels_per_sample: pixels that tell as much as one independent one; scale_sigma: of a
    factor common to all depths, relative; offset_sigma: of an offset common to all 1/z, 1/m.

        >>> noise = DepthNoise.stereo(focal_px=617.0, baseline_m=0.05)
        >>> round(1e3 * float(noise.sigma_z(0.5)), 3)
        0.648
    """

    inverse_sigma: float
    pixels_per_sample: float = 1.0
    scale_sigma: float = 0.0
    offset_sigma: float = 0.0

    def __post_init__(self) -> None:
        shared = min(self.scale_sigma, self.offset_sigma)
        if not (self.inverse_sigma > 0 and self.pixels_per_sample >= 1 and shared >= 0):
            raise InputError(
                "noise of depth: sigma of 1/z above 0, pixels a sample at least 1, sigmas of scale and offset at least "
                f"0, got {self.inverse_sigma:g}, {self.pixels_per_sample:g}, {self.scale_sigma:g}, "
                f"{self.offset_sigma:g}"
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
        offset_px: float = OFFSET_PX,
    ) -> DepthNoise:
        """Of a stereo depth camera, by its disparities' noise and their common offset, px."""
        fb = focal_px * baseline_m
        return cls(disparity_px / fb, pixels_per_sample, scale_sigma, offset_px / fb)

    @property
    def effective(self) -> float:
        """sigma of 1/z that every pixel has where all are taken as independent: right for sums over many."""
        return self.inverse_sigma * self.pixels_per_sample**0.5

    def sigma_z(self, z: Array | float) -> Array:
        """1 sigma of a depth, metres: of one pixel, without the common scale."""
        return np.square(np.asarray(z, dtype=np.float64)) * self.inverse_sigma

    def common_scale(self, z: float) -> float:
        """1 sigma of what all depths about z, metres, are off by together, relative: scale and offset are one there."""
        return float((self.scale_sigma**2 + (self.offset_sigma * z) ** 2) ** 0.5)

    def with_level(self, inverse_sigma: float, pixels_per_sample: float) -> DepthNoise:
        """The same common scale with another noise."""
        return replace(self, inverse_sigma=inverse_sigma, pixels_per_sample=max(pixels_per_sample, 1.0))


D435 = DepthNoise.stereo(focal_px=617.0, baseline_m=0.050)
"""RealSense D435 at 640 x 480 (baseline 50 mm) on texture."""
D455 = DepthNoise.stereo(focal_px=617.0, baseline_m=0.095)
"""RealSense D455 (95 mm)."""
