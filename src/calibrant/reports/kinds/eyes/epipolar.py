"""Results of `calibrant epipolar`: how two pictures see each other."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.data.details import EpipolarMatrices
from calibrant.reports.parts.blocks import Column, TextTable
from calibrant.reports.parts.figures import Fact
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import plain, sigma_text


def _headline(result: CalibrationResult) -> list[Fact]:
    figures = result.figures
    out = []
    for estimate in result.transforms[:1]:
        turns, C = estimate.sigma_rotation_deg, estimate.covariance
        if turns is not None and C is not None:
            out.append(Fact("rotation", f"± {sigma_text(float(turns.max()))} deg", "1σ, worst axis"))
        if "baseline" not in result.options:
            out.append(Fact("length", "unknown", "of the baseline, which is put down as 1000 mm; --baseline gives it"))
    if "fitting" in figures:
        text = f"{figures['fitting'].value:.0f} of {figures['matches'].value:.0f}"
        out.append(Fact("matches on their lines", text, f"to {plain(figures['rms'].value, digits=3)} px RMS"))
    return out


def _tables(result: CalibrationResult) -> list[TextTable]:
    """F and E, as they were found."""
    found = result.detail(EpipolarMatrices)
    if found is None:
        return []
    return [
        TextTable(
            title, tuple(Column(c, True) for c in columns), tuple(tuple(f"{v: .9e}" for v in row) for row in M), note
        )
        for title, columns, M, note in (
            ("Fundamental matrix F", "uv1", found.F, "u_right' F u_left = 0 for pixels (u, v, 1) as they are; norm 1."),
            ("Essential matrix E", "xyz", found.E, "r_right' E r_left = 0 for rays (x, y, z) of the cameras; norm 1."),
        )
        if M is not None
    ]


KIND = Kind("Epipolar geometry", _headline, facts=_headline, tables=_tables, said=("matches",))
