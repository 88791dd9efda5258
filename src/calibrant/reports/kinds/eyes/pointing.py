"""Results of `calibrant point`: the spot of a plane that a pointer points at."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.data.details import PointedSpot
from calibrant.reports.parts.figures import Fact, noise_facts
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import sigma_text, with_sigma


def _scaled(result: CalibrationResult, name: str) -> tuple[float, float, str]:
    """A figure with its sigma as people read it: millimetres, or parts of the plane."""
    figure = result.figures[name]
    times, unit = (1e3, " mm") if figure.unit == "m" else (1.0, "")
    return times * figure.value, times * figure.sigma, unit


def _headline(result: CalibrationResult) -> list[Fact]:
    out = []
    for name in ("x", "y"):
        value, sigma, unit = _scaled(result, name)
        out.append(Fact(f"spot, {name}", f"{with_sigma(value, sigma)}{unit}", "± 1σ, in the plane"))
    return [*out, Fact("95 % lie within", _radius(result), "of it, along the worst direction")]


def _radius(result: CalibrationResult) -> str:
    radius, _, unit = _scaled(result, "radius_95")
    return f"{sigma_text(radius)}{unit}"


def _answer(result: CalibrationResult) -> str:
    return f"The spot is known to {_radius(result)} (95 %)."


def _facts(result: CalibrationResult) -> list[Fact]:
    spot = result.detail(PointedSpot)
    seen = (
        []
        if spot is None
        else [Fact(f"seen {side} at", f"{u:.1f}, {v:.1f} px") for side, (u, v) in spot.seen_px.items()]
    )
    return [*_headline(result), *seen, *noise_facts(result)]


KIND = Kind("Pointing spot", _headline, _answer, _facts, said=("crossing",))
