"""Lengths as colours, and the scale beside the picture that says which colour is how many millimetres.

Small lengths are red and large ones blue: what is near, or sure, catches the eye.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor, log10

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrant.opencv import cv2

TICKS = 7
"""About as many lengths are written beside a scale."""
_INK = (235, 235, 235)
_ONE = 1e-6
"""Of a length, by which others differ that are the same but for rounding."""
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_LEAST_FONT, _FONT_OF_HEIGHT = 0.4, 1 / 800
"""A letter is 22 px high at size 1; below 9 px nobody reads it."""


@dataclass(frozen=True)
class ColourScale:
    """Lengths from low to high, metres, as colours; beyond them the colours of the ends.

    >>> from calibrant.perceive.colour_scale import ColourScale
    >>> ColourScale("z", 0.5, 1.0).ticks_mm
    (500.0, 600.0, 700.0, 800.0, 900.0, 1000.0)
    """

    what: str
    low: float
    high: float

    @classmethod
    def of(cls, what: str, values: ArrayLike, *, outside: float) -> ColourScale:
        """The scale of the lengths (n,) that are finite, but for this part of them at each end; 0 to 0 of none."""
        known = np.asarray(values, dtype=np.float64)
        known = known[np.isfinite(known)]
        low, high = np.quantile(known, [outside, 1 - outside]) if len(known) else (0.0, 0.0)
        return cls(what, float(low), float(high))

    @property
    def ticks_mm(self) -> tuple[float, ...]:
        """Round lengths between low and high, millimetres; of a scale without width its only one."""
        low, high = 1e3 * self.low, 1e3 * self.high
        if high - low <= _ONE * abs(high):
            return (low,)
        rough = (high - low) / TICKS
        power = 10.0 ** floor(log10(rough))
        step = next(power * n for n in (1, 2, 5, 10) if power * n >= rough * (1 - 1e-9))
        first, last = ceil(low / step - 1e-9), floor(high / step + 1e-9)
        return tuple(float(f"{k * step:.12g}") for k in range(first, last + 1))

    def colours(self, values: ArrayLike) -> NDArray[np.uint8]:
        """Colours (..., 3), BGR, of lengths (...), metres; black where they are not finite."""
        given = np.asarray(values, dtype=np.float64)
        known = np.isfinite(given)
        part = np.clip((self.high - np.where(known, given, self.high)) / max(self.high - self.low, 1e-12), 0, 1)
        grey = np.rint(255 * part).astype(np.uint8).reshape(-1, 1)
        out = np.asarray(cv2.applyColorMap(grey, cv2.COLORMAP_TURBO), dtype=np.uint8).reshape(*given.shape, 3)
        out[~known] = 0
        return out

    def beside(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The picture (h, w, 3), BGR, with the scale at its right: (h, more, 3)."""
        height = picture.shape[0]
        size = max(_LEAST_FONT, height * _FONT_OF_HEIGHT)
        line = ceil(30 * size)
        texts = [_text(v, self.ticks_mm) for v in self.ticks_mm]
        heading = f"{self.what}, mm"
        widest = max(cv2.getTextSize(text, _FONT, size, 1)[0][0] for text in (heading, *texts))
        strip = np.zeros((height, line + max(line + widest, ceil(line / 2) + widest), 3), np.uint8)
        top, bottom = 2 * line, max(height - line, 2 * line + 1)
        _write(strip, heading, (line // 2, line), size)
        bar = self.colours(np.linspace(self.low, self.high, bottom - top))
        strip[top:bottom, line // 2 : line + line // 2] = bar[: strip[top:bottom].shape[0], None]
        for value, text in zip(self.ticks_mm, texts):
            part = (1e-3 * value - self.low) / max(self.high - self.low, 1e-12)
            y = round(top + part * (bottom - top - 1))
            cv2.line(strip, (line + line // 2, y), (line + line // 2 + line // 5, y), _INK, 1)
            _write(strip, text, (2 * line - line // 5, y + line // 4), size)
        return np.concatenate([picture, strip], axis=1)


def _text(value: float, every: tuple[float, ...]) -> str:
    """With as many digits after the point as tell the ticks apart."""
    return f"{value:.{max(0, -floor(log10(every[1] - every[0]) + 1e-9))}f}" if len(every) > 1 else f"{value:.4g}"


def _write(canvas: NDArray[np.uint8], text: str, at: tuple[int, int], size: float) -> None:
    cv2.putText(canvas, text, at, _FONT, size, _INK, max(1, round(size)), cv2.LINE_AA)
