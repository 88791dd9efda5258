"""Results of `calibrant undistort`: the camera of pictures without distortion."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.data.details import PictureRegion
from calibrant.reports.parts.figures import Fact
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import plain
from calibrant.reports.parts.phrases import focal_facts, used


def _facts(result: CalibrationResult) -> list[Fact]:
    facts = []
    missing, region = result.figures.get("without_source"), result.detail(PictureRegion)
    if missing is not None:
        facts.append(Fact("without a source", f"{plain(100 * missing.value, digits=2)} %", "of the picture is black"))
    if region is not None:
        text = f"{region.width} × {region.height} px at x {region.x}, y {region.y}"
        facts.append(Fact("largest whole rectangle", text, "every pixel in it has a source"))
    return facts


def _headline(result: CalibrationResult) -> list[Fact]:
    return [*focal_facts(result), *_facts(result), *used(result)]


KIND = Kind("Undistorted pictures", _headline, facts=_facts)
