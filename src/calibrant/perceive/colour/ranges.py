"""A range of colours: hue in degrees, through 0 where the second is smaller, saturation and value in per cent.

Colours are turned into hue, saturation and value as floating-point numbers, so that no hue is rounded to OpenCV's steps
of two degrees.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Mask
from calibrant.errors import InputError
from calibrant.opencv import cv2

SPREADS = 4.0
"""Sigmas of a neighbourhood's colours that a picked range reaches to each side: one pixel in 16 000 lies beyond."""
LEAST_HUE_DEG = 8.0
LEAST_PCT = 12.0
"""A flat neighbourhood (a drawing, a simulation) has no spread; shading over an object is larger than nothing."""
_PART = re.compile(r"([hsv])\s*[:=]\s*(-?\d+(?:\.\d+)?)\s*(?:-|\.\.)\s*(-?\d+(?:\.\d+)?)", re.IGNORECASE)
_FORM = 'h:0-20 s:50-100 v:30-100 (degrees, per cent; hues may run through 0: "h:345-15")'


@dataclass(frozen=True)
class ColourRange:
    """hue_deg: from the first up to the second, through 360 where the second is smaller; saturation_pct and value_pct:
    lowest and highest. All ends belong to the range. Raises: InputError for what is no range.

        >>> red = ColourRange.parse("h:345-15 s:50-100 v:30-100")
        >>> red.hue_deg, red.spec
        ((345.0, 15.0), 'h:345-15 s:50-100 v:30-100')
    """

    hue_deg: tuple[float, float] = (0.0, 360.0)
    saturation_pct: tuple[float, float] = (0.0, 100.0)
    value_pct: tuple[float, float] = (0.0, 100.0)

    def __post_init__(self) -> None:
        if not all(0 <= h <= 360 for h in self.hue_deg):
            raise InputError(f"hues are 0 to 360 degrees, got {self.hue_deg[0]:g} and {self.hue_deg[1]:g}")
        for name, (low, high) in (("saturation", self.saturation_pct), ("value", self.value_pct)):
            if not 0 <= low <= high <= 100:
                raise InputError(f"{name} runs from low to high within 0 to 100 %, got {low:g} to {high:g}")

    @classmethod
    def parse(cls, text: str) -> ColourRange:
        """The range of a text such as "h:345-15 s:50-100 v:30-100"; what is left out may be anything.

        Raises: InputError with the form that is expected.
        """
        parts = {name.lower(): (float(a), float(b)) for name, a, b in _PART.findall(text)}
        if not parts or _PART.sub("", text).strip(" ,;"):
            raise InputError(f"{text!r} is no range of colours; expected {_FORM}")
        return cls(parts.get("h", (0.0, 360.0)), parts.get("s", (0.0, 100.0)), parts.get("v", (0.0, 100.0)))

    @classmethod
    def from_opencv(cls, low: tuple[float, float, float], high: tuple[float, float, float]) -> ColourRange:
        """From OpenCV's 8-bit numbers, as `cv2.inRange` takes them: hue 0 to 179, saturation and value 0 to 255.

        >>> ColourRange.from_opencv((170, 128, 51), (10, 255, 255)).hue_deg
        (340.0, 20.0)
        """
        (h0, s0, v0), (h1, s1, v1) = low, high
        if max(h0, h1) > 179 or max(s0, s1, v0, v1) > 255 or min(*low, *high) < 0:
            raise InputError(f"OpenCV's hues are 0 to 179, saturation and value 0 to 255; got {low} and {high}")
        pct = 100 / 255
        return cls((2.0 * h0, 2.0 * h1), (pct * s0, pct * s1), (pct * v0, pct * v1))

    @classmethod
    def of_pixel(cls, image: NDArray[Any], at: tuple[float, float], *, radius: int = 3) -> ColourRange:
        """The range around a pixel (u, v): median of its neighbourhood, as wide as the colours there spread.

        Args: image (h, w, 3) BGR, 8 bits; radius: of the neighbourhood, pixels. Raises: InputError for a pixel outside.
        """
        height, width = image.shape[:2]
        u, v = round(at[0]), round(at[1])
        if not (0 <= u < width and 0 <= v < height):
            raise InputError(f"pixel {u},{v} lies outside the picture of {width} x {height}")
        rows, columns = (slice(max(n - radius, 0), n + radius + 1) for n in (v, u))
        hue, saturation, value = np.moveaxis(hsv(image[rows, columns]), -1, 0)
        # Hues are angles: their median is taken around their mean direction.
        mean = np.angle(np.mean(saturation * np.exp(1j * np.deg2rad(hue))), deg=True)
        turned = (hue - mean + 180) % 360 - 180
        middle, wide = _spread(turned, LEAST_HUE_DEG)
        hues = (
            (float((mean + middle - wide) % 360), float((mean + middle + wide) % 360)) if wide < 180 else (0.0, 360.0)
        )
        bounds = []
        for channel in (saturation, value):
            m, w = _spread(channel, LEAST_PCT)
            bounds.append((float(max(m - w, 0)), float(min(m + w, 100))))
        return cls(hues, bounds[0], bounds[1])

    @property
    def spec(self) -> str:
        """The text that `parse` reads."""
        parts = zip("hsv", (self.hue_deg, self.saturation_pct, self.value_pct))
        return " ".join(f"{name}:{low:.4g}-{high:.4g}" for name, (low, high) in parts)

    def mask(self, image: NDArray[Any]) -> Mask:
        """Where a picture (h, w, 3), BGR, 8 bits, has such a colour. Raises: InputError for a grey picture."""
        hue, saturation, value = np.moveaxis(hsv(image), -1, 0)
        first, last = self.hue_deg
        within = (hue >= first) & (hue <= last) if first <= last else (hue >= first) | (hue <= last)
        for channel, (low, high) in ((saturation, self.saturation_pct), (value, self.value_pct)):
            within &= (channel >= low - _ROUNDING) & (channel <= high + _ROUNDING)
        return np.asarray(within)


_ROUNDING = 1e-4
"""Per cent: single precision's, so that 100 % is within 0 to 100."""


def hsv(image: NDArray[Any]) -> Array:
    """Hue in degrees, saturation and value in per cent, (h, w, 3), of a BGR picture of 8 bits.

    >>> hsv(np.array([[[0, 0, 255]]], np.uint8)).round().tolist()
    [[[0.0, 100.0, 100.0]]]
    """
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
        raise InputError(
            f"colours need a picture (h, w, 3) of 8 bits, blue, green, red; got {image.shape} of {image.dtype}"
        )
    out = cv2.cvtColor(image.astype(np.float32) * np.float32(1 / 255), cv2.COLOR_BGR2HSV)
    out[..., 1:] *= 100
    return np.asarray(out)


def _spread(values: Array, least: float) -> tuple[float, float]:
    """Median, and the half width of a range."""
    middle = float(np.median(values))
    return middle, max(SPREADS * float(np.median(np.abs(values - middle))) / 0.6745, least)
