"""Why patterns do not add up although they are in order: the camera's pictures saturate, or are bent by a tone curve.

In order, and in proportion to light, a bit and its inverse sum to white + black. Where white is at the end of the
camera's range half a stripe is as bright as all of it, and the sum is too large; what is dimmer, as black squares are,
still adds up. A tone curve leaves what is fully lit or dark and lifts what is half lit, on every stripe's edge alike;
two pictures that are no pair miss to both sides, or by all of the light.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.detection.structured_light.capture import Grey, Picture
from calibrant.detection.structured_light.judged import FULL

DIM = 12.0
"""Grey levels of light that a dim pixel has at least: noise is a tenth of it."""
MOSTLY = 0.5
"""Of the pixels that do not add up: more of them are saturated."""
ENOUGH_DIM = 200
"""Dim pixels that tell whether patterns are in order where the bright ones are saturated."""
ONE_SIDED = 0.95
"""Of the pixels that miss the sum: as many do so to one side by a tone curve, half of them by another pattern."""
CURVED = 0.75
"""Of the light, that a tone curve lifts what is half lit by at most: 2 (1/2)^(1/3) - 1 is 0.59, another pattern's miss
is 1."""


def dim(white: Picture, black: Picture) -> Mask:
    """Where there is light, but not to the end of the camera's range, (h, w)."""
    return np.asarray((white.astype(np.float32) - black > DIM) & (white < FULL))


def saturated_words(white: Picture, lit: Mask, missed: Mask | None = None) -> str:
    """What is said where most of what does not add up is saturated; empty where it is not.

    Args: lit (h, w); missed (n,), which of the lit pixels do not add up, all where it is not given.
    """
    full = white[lit] >= FULL
    concerned = full if missed is None else full[missed]
    if not len(concerned) or concerned.mean() <= MOSTLY:
        return ""
    return (
        f"{full.mean():.0%} of what is lit is saturated in white light ({FULL} of 255 and more), so that half-lit "
        "stripes are as bright as lit ones and no picture adds up with its inverse: expose for less time, or close the "
        "aperture, until white paper is at 200 or less"
    )


def curved_words(off: Array) -> str:
    """What is said where a tone curve bends the pictures; empty where it does not. Args: off (n,), what sums are more
    than white + black, of the light."""
    missed = off[np.abs(off) > MISSED]
    if not len(missed):
        return ""
    up = float((missed > 0).mean())
    if max(up, 1 - up) < ONE_SIDED or float(np.quantile(np.abs(missed), 0.9)) > CURVED:
        return ""
    return (
        f"half-lit pixels are {'brighter' if up > 0.5 else 'darker'} than half by {abs(float(np.median(missed))):.0%} "
        "of the light, on all stripes alike: the camera does not answer in proportion to light. Turn off its gamma, "
        "contrast curves and HDR; raw pictures have none"
    )


MISSED = 0.2
"""Of the light: what a sum is off by where a picture is not the other's inverse, or is bent."""


def adds_up(one: Grey, other: Grey, white: Picture, black: Picture, lit: Mask) -> Array:
    """What a pair's sum is more than white + black, of the light, at the lit pixels (n,)."""
    light = (white - black)[lit]
    return np.asarray((one.astype(np.float32)[lit] + other[lit] - white[lit] - black[lit]) / light)
