"""What `calibrant study methods` shows and writes: tables for the terminal, JSON, and a page with curves."""

from __future__ import annotations

import html
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from calibrant.reports.numbers import plain
from calibrant.studies.methods import USES, Method, Outcome, Use
from calibrant.studies.sweeps import Row, Swept

FORMAT = "calibrant-study/1"
WIDTH = 80
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


@dataclass(frozen=True)
class Compared:
    """A method on the given views: the medians of its runs, how many there were, and how many were refused."""

    method: Method
    outcome: Outcome
    runs: int
    refused: int


@dataclass(frozen=True)
class Study:
    """What was studied, in words, with its comparison and sweeps. `options` made it; `truth` names the reference."""

    subject: str
    truth: str
    options: Mapping[str, object]
    compared: tuple[Compared, ...]
    sweeps: tuple[Swept, ...]


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
    }
    return json.dumps(document, indent=1, ensure_ascii=False)


def tables(study: Study) -> RenderableType:
    """The whole study for a terminal of 80 columns."""
    parts: list[RenderableType] = [Text(study.subject, style="bold"), Text(study.truth, style="dim"), Text()]
    parts += [_compared_table(use, study.compared) for use in USES if any(c.method.use == use for c in study.compared)]
    if study.sweeps:
        parts.append(
            Text("Where each fails: median error of the focal length in %, or why it is refused", style="bold")
        )
        parts.append(
            Text(
                f"Over {study.sweeps[0].trials} scenes a value; a word is a refusal, * says that some were refused.\n",
                style="dim",
            )
        )
    parts += [_sweep_table(s) for s in study.sweeps]
    messages = _refusals(study)
    if messages:
        parts.append(Text("Refusals", style="bold"))
        parts += [Text(m) for m in messages]
    return Group(*parts)


def page(study: Study) -> str:
    """The study as one HTML page: the tables, and a curve a sweep."""
    console = Console(record=True, width=WIDTH + 20, file=io.StringIO())
    console.print(tables(study))
    body = console.export_html(inline_styles=True, code_format="<pre>{code}</pre>")
    figures = "".join(
        f"<figure>{_curves(s)}<figcaption>{html.escape(s.sweep.lesson)}</figcaption></figure>" for s in study.sweeps
    )
    title = html.escape(study.subject)
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title><style>body{{font:16px/1.4 '
        "system-ui,sans-serif;max-width:66rem;margin:2rem auto;padding:0 1rem;color:#222;background:#fff}"
        "pre{font:13px/1.3 ui-monospace,monospace;overflow-x:auto}figure{display:inline-block;margin:0 1rem 1rem 0}"
        "figure svg{max-width:100%;height:auto}figcaption{font-size:.9rem;color:#555}</style>"
        f"<h1>Calibration methods compared</h1>{body}<h2>Curves</h2>{figures}</html>\n"
    )


def _compared_table(use: Use, compared: Sequence[Compared]) -> RenderableType:
    rows = [c for c in compared if c.method.use == use]
    table = _table_block()
    table.add_column("method", no_wrap=True)
    for heading in ("RMS px", "f err %", "c err px", "rot deg", "pos mm", "ms", "refused"):
        table.add_column(heading, justify="right", no_wrap=True)
    for c in rows:
        refused = f"{c.refused}/{c.runs}" if c.refused else ""
        o = c.outcome
        if o.refused is not None:
            table.add_row(c.method.name, Text(o.refused, style="yellow"), "", "", "", "", "", refused)
            continue
        figures = (o.rms_px, o.focal_percent, o.centre_px, o.rotation_deg, o.position_mm)
        table.add_row(c.method.name, *(_figure(v) for v in figures), _figure(o.milliseconds, 2), refused)
    count = max(c.runs for c in rows)
    many = "" if count == 1 else f", median of {count} views"
    return Group(Text(f"{use.capitalize()}{many} (–: taken as known, or not known)", style="bold"), table, Text())


def _sweep_table(swept: Swept) -> RenderableType:
    unit = f" [{swept.sweep.unit}]" if swept.sweep.unit else ""
    table = _table_block()
    table.add_column(f"{swept.sweep.title}{unit}", no_wrap=True)
    for value in swept.sweep.values:
        table.add_column(f"{value:g}", justify="right", no_wrap=True)
    use = ""
    for row in swept.rows:
        if row.use != use:
            use = row.use
            table.add_row(Text(use, style="dim"))
        table.add_row(f"  {row.method}", *(_cell(o, n) for o, n in zip(row.outcomes, row.refused)))
    return Group(table, Text(swept.sweep.lesson, style="dim"), Text())


def _cell(outcome: Outcome, refused: int) -> RenderableType:
    if outcome.refused is not None:
        return Text(SHORT.get(outcome.refused, outcome.refused), style="yellow")
    return Text(_figure(outcome.focal_percent) + "*" * bool(refused))


def _figure(value: float | None, digits: int = 2) -> str:
    if value is None:
        return "–"
    if value == 0 or abs(value) < EXACT_PERCENT:
        return "exact"
    return plain(value, digits=digits) if abs(value) >= 1e-3 else f"{value:.0e}"


def _table_block() -> Table:
    return Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")


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
