"""What is said of a measured surface: how far away its points are, and how well each depth is known."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.reports.parts.figures import Fact
from calibrant.reports.parts.numbers import plain, sigma_text


def depth_facts(result: CalibrationResult, *, frame: str, measured_by: tuple[str, str]) -> list[Fact]:
    """Points, depths and sigmas; none where nothing was measured. frame: whose z it is; measured_by: the figure of the
    sigma that is not the calibration's, and what makes it."""
    figures = result.figures
    name, what = measured_by
    if name not in figures:
        return []
    parts = [sigma_text(1e3 * figures[part].value) for part in (name, "sigma_calibration")]
    nearest, median, farthest = (
        f"{plain(figures[n].value, digits=4)} m" for n in ("nearest", "median_depth", "farthest")
    )
    return [
        Fact("points", f"{figures['points'].value:.0f}", ""),
        Fact("depth, median", median, f"z in the {frame}"),
        Fact("depth, 98 % of points", f"{nearest} … {farthest}", ""),
        Fact("σ of a depth, median", f"{sigma_text(1e3 * figures['sigma_z'].value)} mm", f"{what} and calibration"),
        Fact("its parts", f"{parts[0]} mm, {parts[1]} mm", f"by the {what}, by the calibration (shared by all)"),
    ]


def depth_answer(result: CalibrationResult) -> str:
    """How well a depth is known."""
    sigma = result.figures.get("sigma_z")
    return "" if sigma is None else f"A depth is known to {sigma_text(1e3 * sigma.value)} mm (1σ, median)."
