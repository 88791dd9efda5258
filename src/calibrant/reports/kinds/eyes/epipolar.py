"""Results of `calibrant epipolar`: how two pictures see each other."""

from __future__ import annotations

from calibrant.data import CalibrationResult
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


KIND = Kind("Epipolar geometry", _headline, facts=_headline, said=("matches",))
