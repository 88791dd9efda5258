"""Results that depth cameras give beside poses: their scale, and where they are by one point."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.reports.parts.figures import Fact
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import with_sigma
from calibrant.reports.parts.phrases import first_transform, placed


def _scale(result: CalibrationResult) -> list[Fact]:
    scale = result.figures["scale"]
    said = with_sigma(100 * scale.value, 100 * scale.sigma)
    return [
        Fact("scale of the depth", f"{said} %", "± 1σ, above 0 is too long"),
        Fact("boards", str(len(result.views)), "each with its own scale below"),
    ]


def _point(result: CalibrationResult) -> list[Fact]:
    points = [(n, m) for n, m in result.figures.items() if n.startswith("point_")]
    seen = ", ".join(with_sigma(m.value, m.sigma) for _, m in points)
    where = points[0][0].rsplit("_", 1)[1] if points else ""
    return [*placed(result), Fact("the point", f"{seen} mm", f"x, y, z in the {where}'s frame, ± 1σ")]


SCALE = Kind("Depth against boards", _scale, said=("scale", "tolerance"))
ONE_POINT = Kind("Hand-eye from one point", _point, first_transform, rows="poses", said=("noise",))
