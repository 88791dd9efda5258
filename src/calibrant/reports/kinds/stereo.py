"""Results of `calibrant stereo`: two cameras, how they stand to each other, and how well they measure together."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.data.details import EpipolarErrors
from calibrant.reports.parts.blocks import Column, TextTable
from calibrant.reports.parts.figures import Fact, noise_facts
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import plain, with_sigma
from calibrant.reports.parts.phrases import errors, transform_facts, used

NOTES = {
    "baseline": "between the cameras' centres, ± 1σ",
    "epipolar RMS": "of points from the lines of their partners, both images, undistorted",
    "edge RMS": "of distances between neighbouring points of the board, triangulated",
    "depth": "of a point amid the boards, ± 1σ by the calibration",
    "depth noise of a match": "1σ there, by the pixel noise of one match",
}
"""What each figure is of."""
_NAMES = {"epipolar RMS": "epipolar error, RMS", "edge RMS": "edges triangulated, RMS"}


def _figure(result: CalibrationResult, name: str) -> list[Fact]:
    figure = result.figures.get(name)
    if figure is None:
        return []
    known = figure.sigma == figure.sigma
    text = with_sigma(figure.value, figure.sigma) if known else plain(figure.value, digits=3)
    return [Fact(_NAMES.get(name, name), f"{text} {figure.unit}", NOTES[name])]


def _headline(result: CalibrationResult) -> list[Fact]:
    return [
        *_figure(result, "baseline"),
        *transform_facts(result.transforms[:1]),
        *errors(result, "RMS error"),
        *_figure(result, "epipolar RMS"),
        *_figure(result, "edge RMS"),
        *used(result),
    ]


def _facts(result: CalibrationResult) -> list[Fact]:
    return [*(fact for name in NOTES for fact in _figure(result, name)), *noise_facts(result)]


def _answer(result: CalibrationResult) -> str:
    baseline, depth = result.figures.get("baseline"), result.figures.get("depth")
    if baseline is None or baseline.sigma != baseline.sigma:
        return ""
    text = f"The cameras are {with_sigma(baseline.value, baseline.sigma)} mm apart"
    if depth is not None:
        at, off = plain(depth.value, digits=3), plain(depth.sigma, digits=2)
        text += f"; a point {at} mm away is known to {off} mm in depth by the calibration"
    return f"{text} (1σ)."


def _tables(result: CalibrationResult) -> list[TextTable]:
    found = result.detail(EpipolarErrors)
    if found is None:
        return []
    columns = (Column("pair"), Column("points", True), *(Column(f"{n} px", True) for n in ("RMS", "min", "max")))
    rows = tuple(
        (
            f"{pair.left}, {pair.right}" if pair.left != pair.right else pair.left,
            str(len(pair.point_ids)),
            *(plain(v, digits=3) for v in (pair.rms_px, pair.min_px, pair.max_px)),
        )
        for pair in found.pairs.values()
    )
    note = f"Over both images; the pixels' noise makes {plain(found.expected_px, digits=3)} px."
    return [TextTable("Distances from the lines of the partners", columns, rows, note)]


KIND = Kind("Stereo calibration", _headline, _answer, _facts, tables=_tables, said=("sides",))
