"""Results of `calibrant scan`: a scene measured by the patterns of a projector."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.reports.parts.figures import Fact
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import plain, sigma_text


def _metres(result: CalibrationResult, name: str) -> str:
    return f"{plain(result.figures[name].value, digits=4)} m"


def _headline(result: CalibrationResult) -> list[Fact]:
    figures = result.figures
    if "sigma_pixels" not in figures:
        return []
    parts = [sigma_text(1e3 * figures[name].value) for name in ("sigma_pixels", "sigma_calibration")]
    return [
        Fact("points", f"{figures['points'].value:.0f}", ""),
        Fact("depth, median", _metres(result, "median_depth"), "z in the camera"),
        Fact("depth, 98 % of points", f"{_metres(result, 'nearest')} … {_metres(result, 'farthest')}", ""),
        Fact("σ of a depth, median", f"{sigma_text(1e3 * figures['sigma_z'].value)} mm", "pixels and calibration"),
        Fact("its parts", f"{parts[0]} mm, {parts[1]} mm", "by the pixels, by the calibration (shared by all)"),
        Fact("off the epipolar lines", f"{plain(figures['across'].value, digits=2)} σ", "RMS; 1 by noise alone"),
    ]


def _answer(result: CalibrationResult) -> str:
    sigma = result.figures.get("sigma_z")
    return "" if sigma is None else f"A depth is known to {sigma_text(1e3 * sigma.value)} mm (1σ, median)."


KIND = Kind("Scan", _headline, _answer, facts=_headline, said=("scanned", "epipolar", "certainty"))
