"""What the light of captures says, as checks: each names the captures it concerns, and the cure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from calibrant.data import Check
from calibrant.detection.structured_light.judged import CaptureFigures

LEAST_DECODED = 0.3
"""Share of the board's pixels: white squares alone are half."""
LEAST_DIRECT = 0.5
"""Share of the light: below, most of it comes by way of other things, or from neighbouring stripes."""
MOST_SATURATED = 0.05
"""Share of the board's pixels: white squares that bloom shift the corners between them."""
MOST_BEND = 0.1
"""Of the light: a tenth brighter than half moves cosines by a sixtieth of a period."""
MOST_ALIKE = 0.25
"""Correlation: linear interpolation between pixels leaves a quarter on the average."""
MOST_UNEVEN = 0.15
"""Scatter of widths: one stripe of forty that is missing or double; blur and noise leave a third of it."""
_MOST_NAMED = 4

Figures = Sequence[tuple[str, CaptureFigures]]


def light_checks(captures: Figures, code: str) -> Iterator[Check]:
    """The checks of captures, (name, figures) each."""
    yield _check(
        "light-decoded",
        captures,
        lambda f: f.decoded,
        lambda v: v < LEAST_DECODED,
        "{value} of the board's pixels are decoded at least",
        "light the board better: expose for longer, darken the room",
    )
    yield _check(
        "light-direct",
        captures,
        lambda f: f.direct,
        lambda v: v < LEAST_DIRECT,
        "{value} of the light on the board comes straight from the projector at least",
        "the rest comes by way of other surfaces, or stripes blur into each other: shade what throws light back, focus",
    )
    yield _check(
        "light-saturated",
        captures,
        lambda f: f.saturated,
        lambda v: v > MOST_SATURATED,
        "{value} of the board's pixels are saturated in white light at most",
        "white squares bloom over the corners: expose for less time",
        largest=True,
    )
    bent = (
        "the camera answers light in proportion: half-lit pixels are off by {value} of the light at most"
        if code == "gray"
        else "the cosines' second harmonic is {value} of the first at most"
    )
    cure = (
        "turn off the camera's gamma and its contrast curves"
        if code == "gray"
        else "the projector's gamma is on: set it to 1, or show five shifts or more, which cancel it"
    )
    yield _check(
        "light-gamma", captures, lambda f: abs(f.bend), lambda v: v > MOST_BEND, bent, cure, largest=True
    )  # fmt: skip
    yield from _sampling(captures)


def _sampling(captures: Figures) -> Iterator[Check]:
    if any(f.alike is not None for _, f in captures):
        yield _check(
            "camera-resampled",
            [(n, f) for n, f in captures if f.alike is not None],
            lambda f: f.alike or 0.0,
            lambda v: v > MOST_ALIKE,
            "the noise of neighbouring pixels correlates by {number} at most",
            "the camera's pictures were resampled or compressed on the way: save what the sensor has, at its own size",
            largest=True,
        )
    if any(f.stripes is not None for _, f in captures):
        yield _check(
            "projector-resampled",
            [(n, f) for n, f in captures if f.stripes is not None],
            lambda f: f.stripes or 0.0,
            lambda v: v > MOST_UNEVEN,
            "the stripes' widths differ by {value} at most",
            "the projector resamples its picture: switch keystone correction and scaling off, and give it its own "
            "resolution; stripes are no whole number of its pixels",
            largest=True,
        )


def _check(
    name: str,
    captures: Figures,
    value: Callable[[CaptureFigures], float],
    bad: Callable[[float], bool],
    text: str,
    cure: str,
    *,
    largest: bool = False,
) -> Check:
    values = {n: value(f) for n, f in captures}
    worst = (max if largest else min)(values.values())
    said = text.format(value=f"{worst:.1%}" if worst < 0.1 else f"{worst:.0%}", number=f"{worst:.2f}")
    named = [n for n, v in values.items() if bad(v)]
    if not named:
        return Check(name, "ok", said, worst)
    more = f" and {len(named) - _MOST_NAMED} more" if len(named) > _MOST_NAMED else ""
    return Check(name, "warn", f"{said} ({', '.join(named[:_MOST_NAMED])}{more}): {cure}", worst)
