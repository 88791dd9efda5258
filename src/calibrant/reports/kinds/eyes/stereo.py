"""Results of `calibrant stereo`: two cameras, how they stand to each other, and how well they measure together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from calibrant.arrays import Array
from calibrant.data import CalibrationResult
from calibrant.data.details import EpipolarErrors
from calibrant.reports.parts.blocks import Block, Column, TextTable
from calibrant.reports.parts.figures import Fact, noise_facts
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import plain, with_sigma
from calibrant.reports.parts.phrases import errors, transform_facts, used

if TYPE_CHECKING:
    from calibrant.diagnose.look import DrawnPair, Look

NOTES = {
    "baseline": "between the cameras' centres, ± 1σ",
    "epipolar RMS": "of points from the lines of their partners, both images, undistorted",
    "edge RMS": "of distances between neighbouring points of the board, triangulated",
    "depth": "of a point amid the boards, ± 1σ by the calibration",
    "depth noise of a match": "1σ there, by the pixel noise of one match",
}
"""What each figure is of."""
_MOST_PAIRS = 12
"""More pairs would make the page long; the worst are looked at."""
_GAP, _EYE = 0.02, 450
"""Between the pictures, of the left one's width; widths of a line that make up a picture."""
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
            *(f"{v:.3f}" for v in (pair.rms_px, pair.min_px, pair.max_px)),
        )
        for pair in found.pairs.values()
    )
    note = f"Over both images; the pixels' noise makes {plain(found.expected_px, digits=3)} px."
    return [TextTable("Distances from the lines of the partners", columns, rows, note)]


def _blocks(look: Look) -> list[Block]:
    """The pairs side by side, the worst first, each with the lines of some of its points."""
    pairs = look.drawn_pairs[:_MOST_PAIRS]
    if not pairs:
        return []
    return [Block("pairs", {"pairs": [_side_by_side(p) for p in pairs], "count": len(look.drawn_pairs)})]


def _side_by_side(pair: DrawnPair) -> dict[str, Any]:
    """Both pictures in one drawing of one height, the right one scaled to the left one's."""
    (w, h), (w_right, h_right) = pair.size_left, pair.size_right
    scale, gap = h / h_right, _GAP * w
    sides = [
        {"key": "/".join(name), "x": x, "scale": s, "width": size[0], "height": size[1], "points": points, "unit": unit}
        for name, x, s, size, points, unit in (
            (pair.left, 0.0, 1.0, pair.size_left, _points(pair.uv_left, pair.curves_left), w / _EYE),
            (pair.right, w + gap, scale, pair.size_right, _points(pair.uv_right, pair.curves_right), w / _EYE / scale),
        )
    ]
    left, right = pair.left[1], pair.right[1]
    name = f"{left} and {right}" if left != right else left
    return {"name": name, "sides": sides, "width": w + gap + scale * w_right, "height": h, "rms": pair.rms_px}


def _points(uv: Array, curves: Sequence[Array]) -> list[dict[str, Any]]:
    return [
        {"x": float(x), "y": float(y), "line": " ".join(f"{u:.1f},{v:.1f}" for u, v in curve)}
        for (x, y), curve in zip(uv, curves)
    ]


KIND = Kind("Stereo calibration", _headline, _answer, _facts, tables=_tables, blocks=_blocks, said=("sides",))
