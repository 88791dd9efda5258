"""What the doctor found: no calibration, but findings with their confidence, evidence and cure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calibrant.data import CalibrationResult
from calibrant.data.details import Deviations, Fault, Faults
from calibrant.reports.parts.blocks import Block, Column, TextTable, bars
from calibrant.reports.parts.figures import Fact
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.phrases import decisions

if TYPE_CHECKING:
    from rich.console import RenderableType

    from calibrant.diagnose.look import Look

FINDING_WORDS = {"ok": "noted", "warn": "warning", "fail": "FAULT"}
FINDING_STYLES = {"ok": "", "warn": "yellow", "fail": "bold red"}
NOTHING = "nothing wrong found"
LOOPS = {
    "before": "all views, as given",
    "after": "all views, repaired",
    "agreeing": "the views that agree best",
}
"""What each loop is over; those that agree best tell how the poses are read. The figures differ where a few views are
worse than the others."""
VERDICT_STYLES = {"ok": "bold green", "warn": "bold yellow", "refused": "bold red"}


def faults(result: CalibrationResult) -> tuple[Fault, ...]:
    """The findings of a result, worst first; empty for none."""
    found = result.detail(Faults)
    return () if found is None else found.found


def confidence(value: float) -> str:
    """A confidence in per cent that is never rounded up to certainty."""
    return "> 99.9 %" if value > 0.999 else f"{100 * value:.1f} %"


def _loop(result: CalibrationResult, when: str) -> str:
    """The loop in words, empty where the motions determine none."""
    mm, deg = (result.figures.get(f"loop_{when}_{unit}") for unit in ("mm", "deg"))
    return "" if mm is None or deg is None else f"{mm.value:.3g} mm / {deg.value:.2g} deg"


def _headline(result: CalibrationResult) -> list[Fact]:
    found = faults(result)
    facts = [Fact("findings", ", ".join(f"{FINDING_WORDS[f.status]}: {f.name}" for f in found) or NOTHING)]
    before, after = _loop(result, "before"), _loop(result, "after")
    if before:
        facts.append(Fact("loop as given, RMS", before, "how far the poses are from closing"))
    if after and after != before:
        facts.append(Fact("loop repaired, RMS", after, "with the proposed repairs"))
    return facts


def _answer(result: CalibrationResult) -> str:
    if not faults(result):
        return "Nothing wrong found."
    before, after = _loop(result, "before"), _loop(result, "after")
    repaired = f": the loop then closes to {after} instead of {before}" if after != before else ""
    return f"The data can be repaired{repaired}." if any(f.proposal for f in faults(result)) else ""


def verdict(result: CalibrationResult) -> tuple[str, str]:
    """What is to be done with the data, in a word and in a sentence."""
    found = faults(result)
    hopeless = [f.name for f in found if f.status == "fail" and not f.proposal]
    curable = [f.name for f in found if f.status != "ok" and f.proposal]
    before, after = _loop(result, "before"), _loop(result, "after")
    if hopeless:
        return "NOT FIT", f"{_names(hopeless)}: no repair of the data cures that; see what was found."
    if curable:
        loop = f" Repaired, the loop closes to {after} instead of {before}." if after and after != before else ""
        return "REPAIR FIRST", f"{_names(curable)}.{loop}"
    doubts = [f.name for f in found if f.status == "warn"]
    if doubts:
        return "FIT, WITH CARE", f"{_names(doubts)}: nothing to repair; see what was found."
    return "FIT", "Nothing wrong found."


def _names(names: list[str]) -> str:
    return ", ".join(dict.fromkeys(names))


def _terminal(result: CalibrationResult) -> list[RenderableType]:
    """What was found, the worst first, each with its confidence and what to do; the loops; the verdict last."""
    from rich.padding import Padding
    from rich.text import Text

    parts: list[RenderableType] = [Text("Doctor", style="bold"), Text(decisions(result)), Text()]
    for f in faults(result):
        heading = f"{FINDING_WORDS[f.status]}  {f.name}  (confidence {confidence(f.confidence)})"
        parts.append(Text(heading, style=FINDING_STYLES[f.status]))
        parts.append(Padding(Text(f.message), (0, 0, 0, 4)))
        if f.proposal:
            parts.append(Padding(Text(f"proposed: {f.proposal}"), (0, 0, 0, 4)))
    if not faults(result):
        parts.append(Text(NOTHING, style="green"))
    loops = [(name, loop) for when, name in LOOPS.items() if (loop := _loop(result, when))]
    if _loop(result, "before") == _loop(result, "after"):
        loops = [("all views", loop) for _, loop in loops[:1]] + loops[2:]
    if loops:
        width = max(len(name) for name, _ in loops)
        lines = "\n".join(f"  {name:{width}}  {loop}" for name, loop in loops)
        parts += [Text(), Text(f"The loop, rms\n{lines}")]
    word, sentence = verdict(result)
    style = VERDICT_STYLES[result.verdict]
    return [*parts, Text(), Text.assemble((f"Verdict: {word}.", style), f" {sentence}")]


def _reading(result: CalibrationResult) -> str:
    """How the poses were read and why, as the doctor's own check says it."""
    return next((c.message for c in result.checks if c.name == "pose-reading"), result.decided.get("pose_reading", ""))


def _page(look: Look) -> list[Block]:
    result = look.result
    columns = (Column("Finding"), Column("Confidence", True), Column("What was found"), Column("Proposed"))
    rows = tuple(
        (f"{FINDING_WORDS[f.status]}: {f.name}", confidence(f.confidence), f.message, f.proposal)
        for f in faults(result)
    )
    note = f"{_reading(result)}." if not _reading(result).endswith(".") else _reading(result)
    table = TextTable("What is wrong with the data", columns, rows, note, tuple(f.status for f in faults(result)))
    found = result.detail(Deviations)
    if found is None:
        return [table.block]
    names = [v.id for v in found.views]
    charts = (
        bars("Position of the target, view by view", "mm", names, {
            "as given": [v.before_mm for v in found.views], "repaired": [v.after_mm for v in found.views],
        }),
        bars("Rotation of the target, view by view", "deg", names, {
            "as given": [v.before_deg for v in found.views], "repaired": [v.after_deg for v in found.views],
        }),
    )  # fmt: skip
    return [table.block, *(chart for chart in charts if chart is not None)]


KIND = Kind("What the doctor says", _headline, _answer, page=_page, terminal=_terminal, judged=verdict)
