"""Results of `calibrant projector calibrate`: a projector, its camera, and what each capture was worth."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.data.details_scene import ProjectorCaptures
from calibrant.reports.parts.blocks import Column, TextTable
from calibrant.reports.parts.figures import Fact, camera_figures, noise_facts
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import plain, with_sigma
from calibrant.reports.parts.phrases import errors, transform_facts, used


def _focal(result: CalibrationResult) -> list[Fact]:
    return [
        Fact(f"projector {f.name}", f.text, "" if f.fixed else "± 1σ")
        for f in camera_figures(result.cameras["projector"])
        if f.name in ("fx", "fy")
    ]


def _headline(result: CalibrationResult) -> list[Fact]:
    return [*_focal(result), *transform_facts(result.transforms[:1]), *errors(result, "RMS error"), *used(result)]


def _facts(result: CalibrationResult) -> list[Fact]:
    out = []
    for name in result.cameras:
        rms = [(v.rms_px, v.points) for v in result.views if v.camera == name and v.used and v.rms_px is not None]
        points = sum(n for _, n in rms)
        if points:
            value = (sum(n * r * r for r, n in rms) / points) ** 0.5
            out.append(Fact(f"RMS error in the {name}", f"{plain(value, digits=3)} px", f"of {points} corners"))
    return [*noise_facts(result), *out]


def _answer(result: CalibrationResult) -> str:
    figures = {f.name: f for f in camera_figures(result.cameras["projector"])}
    f = figures.get("fx")
    t = next((t for t in result.transforms if (t.parent, t.child) == ("camera", "projector")), None)
    if f is None or not f.sigma or t is None or t.covariance is None:
        return ""
    at = t.matrix[:3, 3]
    distance = float((at @ at) ** 0.5)
    sigma = float((at @ t.covariance[3:, 3:] @ at) ** 0.5 / distance)
    return (
        f"The projector's focal length is known to {plain(100 * f.sigma / f.value, digits=2)} %, and that it is "
        f"{with_sigma(1e3 * distance, 1e3 * sigma)} mm from the camera (1σ)."
    )


def _tables(result: CalibrationResult) -> list[TextTable]:
    found = result.detail(ProjectorCaptures)
    if found is None:
        return []
    columns = (
        Column("capture"),
        *(Column(name, True) for name in ("corners", "carried", "RMS, px")),
        *(Column(name, True) for name in ("decoded", "direct light", "too bright", "1σ, px", "noise, grey")),
    )
    rows = tuple(
        (
            c.name,
            str(c.corners),
            str(c.carried),
            "–" if c.rms_px is None else plain(c.rms_px, digits=3),
            *(f"{share:.0%}" for share in (c.decoded, c.direct, c.saturated)),
            plain(c.sigma_px, digits=2),
            plain(c.noise, digits=2),
        )
        for c in found.captures
    )
    statuses = tuple("ok" if c.rms_px is not None else "fail" for c in found.captures)
    note = (
        f"{found.patterns} patterns each ({found.code}). Carried: corners whose place in the projector is known too; "
        "RMS is theirs there, 1σ that of one camera pixel, in px of the projector. Shares are of the board's pixels."
    )
    return [TextTable("Captures", columns, rows, note, statuses)]


KIND = Kind(
    "Projector calibration", _headline, _answer, _facts, tables=_tables, said=("lens-shift", "weak-terms-projector")
)
