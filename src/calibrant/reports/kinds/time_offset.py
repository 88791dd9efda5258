"""Results of `calibrant time-offset`: how far two clocks are apart."""

from __future__ import annotations

from math import isfinite

from calibrant.data import CalibrationResult
from calibrant.reports.parts.figures import Fact, noise_facts
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import sigma_text, with_sigma
from calibrant.reports.parts.phrases import placed


def _offset(result: CalibrationResult) -> list[Fact]:
    offset = result.figures.get("offset")
    if offset is None:
        return []
    text = f"{with_sigma(1e3 * offset.value, 1e3 * offset.sigma)} ms"
    return [Fact("clock offset", text, "t_robot = t_camera + offset")]


def _answer(result: CalibrationResult) -> str:
    offset = result.figures.get("offset")
    if offset is None or not isfinite(offset.sigma):
        return ""
    return f"The offset is known to {sigma_text(1e3 * offset.sigma)} ms (1σ)."


def _headline(result: CalibrationResult) -> list[Fact]:
    return [*_offset(result), *placed(result)]


def _facts(result: CalibrationResult) -> list[Fact]:
    return [*_offset(result), *noise_facts(result)]


KIND = Kind("Time offset between camera and robot", _headline, _answer, _facts)
