"""What `calibrant study methods` shows and writes: tables for the terminal, JSON, and a page with curves."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

from markupsafe import Markup
from rich.console import Group, RenderableType
from rich.text import Text

from calibrant.reports.page import render
from calibrant.reports.parts.blocks import Block, Column, Page, TextTable
from calibrant.reports.parts.numbers import plain
from calibrant.reports.terminal import text_table
from calibrant.studies.methods import USES, Method, Outcome, Use
from calibrant.studies.stereo_pair import StereoComparison
from calibrant.studies.sweeps import Row, Swept

FORMAT = "calibrant-study/1"
SHORT = {
    "fronto-parallel": "facing",
    "coplanar points": "coplanar",
    "collinear points": "on a line",
    "too few points": "few",
    "no points on the axes": "no axes",
    "no positive focal length": "no f > 0",
    "points behind the camera": "behind",
    "parallel planes": "parallel",
    "undetermined": "open",
    "mirrored points": "mirrored",
    "too few views": "few views",
}
"""A failure's name in a narrow column; the list below the tables gives the name and the message."""
EXACT_PERCENT = 1e-7
"""Below 1e-9 of the value, what the methods promise on exact points, an error is shown as exact."""


EXACT_MM = 1e-6
"""A nanometre: exact points leave less."""


@dataclass(frozen=True)
class Compared:
    """A method on the given views: the medians of its runs, how many there were, and how many were refused."""

    method: Method
    outcome: Outcome
    runs: int
    refused: int


@dataclass(frozen=True)
class Study:
    """What was studied, in words, with its comparison and sweeps. `options` made it; `truth` names the reference.

    stereo: two ways to measure points with two cameras, for simulated ones.
    """

    subject: str
    truth: str
    options: Mapping[str, object]
    compared: tuple[Compared, ...]
    sweeps: tuple[Swept, ...]
    stereo: StereoComparison | None = None


def study_text(study: Study) -> str:
    """The study as JSON."""
    compared = [
        {
            "method": c.method.name,
            "use": c.method.use,
            "source": c.method.source,
            "runs": c.runs,
            "refused_runs": c.refused,
            **_known(c.outcome),
        }
        for c in study.compared
    ]
    sweeps = [
        {
            "condition": s.sweep.title,
            "unit": s.sweep.unit,
            "lesson": s.sweep.lesson,
            "values": list(s.sweep.values),
            "trials": s.trials,
            "methods": [
                {
                    "method": r.method,
                    "use": r.use,
                    "refused_runs": list(r.refused),
                    "outcomes": [_known(o) for o in r.outcomes],
                }
                for r in s.rows
            ],
        }
        for s in study.sweeps
    ]
    document = {
        "format": FORMAT,
        "subject": study.subject,
        "truth": study.truth,
        "options": dict(study.options),
        "methods": compared,
        "sweeps": sweeps,
        **({} if study.stereo is None else {"stereo": _stereo_known(study.stereo)}),
    }
    return json.dumps(document, indent=1, ensure_ascii=False)


def study_tables(study: Study) -> list[TextTable]:
    """The study's tables, for a terminal and for a page."""
    found = [_compared_table(use, study.compared) for use in USES if any(c.method.use == use for c in study.compared)]
    if study.stereo is not None:
        found.append(_stereo_table(study.stereo))
    if study.sweeps:
        heading = "Where each fails: median error of the focal length in %, or why it is refused"
        scenes = study.sweeps[0].trials
        note = f"Over {scenes} scenes a value; a word is a refusal, * says that some were refused."
        found.append(TextTable(heading, (), (), note))
    found += [_sweep_table(s) for s in study.sweeps]
    messages = _refusals(study)
    if messages:
        found.append(TextTable("Refusals", (Column(""),), tuple((m,) for m in messages)))
    return found


def tables(study: Study) -> RenderableType:
    """The whole study for a terminal of 80 columns."""
    head = [Text(study.subject, style="bold"), Text(study.truth, style="dim"), Text()]
    return Group(*head, *map(text_table, study_tables(study)))


def page(study: Study) -> str:
    """The study as one HTML page: the tables, and a curve a sweep."""
    blocks = [table.block for table in study_tables(study)]
    if study.sweeps:
        curves = [{"svg": Markup(_curves(s)), "caption": s.sweep.lesson} for s in study.sweeps]
        blocks.append(Block("curves", {"heading": "Curves", "curves": curves}))
    return render(Page("Calibration methods compared", "", "", f"{study.subject}. {study.truth}", (), blocks))


def _compared_table(use: Use, compared: Sequence[Compared]) -> TextTable:
    rows = [c for c in compared if c.method.use == use]
    names = ("RMS px", "f err %", "c err px", "rot deg", "pos mm", "ms", "refused")
    columns = (Column("method"), *(Column(name, number=True) for name in names))
    texts: list[tuple[str, ...]] = []
    for c in rows:
        refused = f"{c.refused}/{c.runs}" if c.refused else ""
        o = c.outcome
        if o.refused is not None:
            texts.append((c.method.name, o.refused, "", "", "", "", "", refused))
            continue
        figures = (o.rms_px, o.focal_percent, o.centre_px, o.rotation_deg, o.position_mm)
        texts.append((c.method.name, *(_figure(v) for v in figures), _figure(o.milliseconds, 2), refused))
    count = max(c.runs for c in rows)
    many = "" if count == 1 else f", median of {count} views"
    return TextTable(f"{use.capitalize()}{many} (–: taken as known, or not known)", columns, tuple(texts))


def _stereo_known(stereo: StereoComparison) -> dict[str, object]:
    rows = [{k: v for k, v in asdict(row).items() if v not in (None, ())} for row in stereo.rows]
    return {"distances_m": list(stereo.distances), "methods": rows}


def _stereo_table(stereo: StereoComparison) -> TextTable:
    """Errors of points that two cameras measure, by distance."""
    columns = (Column("method"), *(Column(f"{d:g} m", number=True) for d in stereo.distances))
    blank = ("",) * (len(stereo.distances) - 1)
    rows = tuple(
        (row.method, row.refused, *blank)
        if row.refused is not None
        else (row.method, *("exact" if v < EXACT_MM else plain(v, digits=2) for v in row.error_mm))
        for row in stereo.rows
    )
    note = "New points by two cameras 150 mm apart, calibrated on two boards at right angles 0.5 to 0.7 m away."
    return TextTable("Stereo: median error of a point in mm, by its distance", columns, rows, note)


def _sweep_table(swept: Swept) -> TextTable:
    unit = f" [{swept.sweep.unit}]" if swept.sweep.unit else ""
    name = f"{swept.sweep.title}{unit}"
    columns = (Column("method"), *(Column(f"{value:g}", number=True) for value in swept.sweep.values))
    rows: list[tuple[str, ...]] = []
    use = ""
    for row in swept.rows:
        if row.use != use:
            use = row.use
            rows.append((use, *("" for _ in swept.sweep.values)))
        rows.append((f"  {row.method}", *(_cell(o, n) for o, n in zip(row.outcomes, row.refused))))
    return TextTable(name, columns, tuple(rows), swept.sweep.lesson)


def _cell(outcome: Outcome, refused: int) -> str:
    if outcome.refused is not None:
        return SHORT.get(outcome.refused, outcome.refused)
    return _figure(outcome.focal_percent) + "*" * bool(refused)


def _figure(value: float | None, digits: int = 2) -> str:
    if value is None:
        return "–"
    if value == 0 or abs(value) < EXACT_PERCENT:
        return "exact"
    return plain(value, digits=digits) if abs(value) >= 1e-3 else f"{value:.0e}"


def _refusals(study: Study) -> list[str]:
    """A line a failure: its short form, its name and one of its messages."""
    runs = [c.outcome for c in study.compared] + [o for s in study.sweeps for r in s.rows for o in r.outcomes]
    first: dict[str, str] = {}
    for outcome in runs:
        if outcome.refused is not None and outcome.message is not None:
            first.setdefault(outcome.refused, outcome.message)
    return [f"{SHORT[n]}: {m}" if n in SHORT else m for n, m in sorted(first.items())]


def _known(outcome: Outcome) -> dict[str, object]:
    return {name: value for name, value in asdict(outcome).items() if value is not None}


def _curves(swept: Swept) -> str:
    """Errors of all methods along a sweep, logarithmic, as SVG; refused values leave a gap."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    axes = figure.add_subplot()
    places = range(len(swept.sweep.values))
    styles: Mapping[str, str] = dict(zip(USES, ("-", "--", ":")))
    for row in swept.rows:
        axes.plot(places, _heights(row), styles[row.use], marker="o", markersize=3, label=f"{row.method} ({row.use})")
    axes.set_yscale("log")
    axes.set_xticks(places, [f"{v:g}" for v in swept.sweep.values])
    axes.set_xlabel(f"{swept.sweep.title} {swept.sweep.unit}".strip())
    axes.set_ylabel("focal length error, %")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    drawn = io.StringIO()
    figure.savefig(drawn, format="svg")
    text = drawn.getvalue()
    return text[text.index("<svg") :]


def _heights(row: Row) -> list[float]:
    """Errors in %, cut at 1e-4 % so that exact ones stay on the page; NaN where refused."""
    return [max(o.focal_percent, 1e-4) if o.focal_percent is not None else float("nan") for o in row.outcomes]
