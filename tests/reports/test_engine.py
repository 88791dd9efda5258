"""One engine: reports format and calculate nothing, what both show is computed once, a new kind is one registration."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from pathlib import Path

import pytest

import calibrant
from calibrant.data import CalibrationResult, Check, Measured
from calibrant.data.result_file import read_result
from calibrant.diagnose import loop as loops
from calibrant.diagnose.look import look
from calibrant.reports.html import report_page
from calibrant.reports.kinds import registry
from calibrant.reports.parts.blocks import Column, TextTable, bars
from calibrant.reports.parts.figures import Fact
from calibrant.reports.parts.kind import Kind
from calibrant.reports.terminal import summary

PACKAGE = Path(calibrant.__file__).parent
REPORTS = sorted((PACKAGE / "reports").rglob("*.py"))
OLD = sorted((Path(__file__).parents[1] / "data" / "format_one").glob("*.json"))


@pytest.mark.parametrize("file", REPORTS, ids=lambda f: str(f.relative_to(PACKAGE)))
def test_reports_import_nothing_that_calculates(file: Path) -> None:
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        names += [a.name for a in node.names] if isinstance(node, ast.Import) else []
        assert not [n for n in names if n.startswith(("calibrant.calibrate", "calibrant.optimize"))]


def test_one_look_solves_the_loop_once(
    monkeypatch: pytest.MonkeyPatch, hand_eye_result: Callable[[str], CalibrationResult]
) -> None:
    asked = []
    monkeypatch.setattr(loops, "seen_poses", lambda result, solve=loops.seen_poses: asked.append(1) or solve(result))
    seen = look(hand_eye_result("eye-in-hand"))
    summary(seen)
    assert "In space" in report_page(seen)
    assert len(asked) == 1


def test_every_kind_is_registered() -> None:
    """Those of format 1, and those that tasks and calibrations make: a kind without a line would have a bare title."""
    assert {read_result(file).kind for file in OLD} <= set(registry.KINDS)
    assert made_kinds() == set(registry.KINDS)


def made_kinds() -> set[str]:
    """The kind, written out, of every result that is made in the package; both of a choice."""
    found = set()
    for file in PACKAGE.rglob("*.py"):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        constants = {
            target.id: statement.value
            for statement in tree.body
            if isinstance(statement, ast.Assign)
            for target in statement.targets
            if isinstance(target, ast.Name)
        }
        for node in ast.walk(tree):
            name = getattr(node.func, "id", "") if isinstance(node, ast.Call) else ""
            if isinstance(node, ast.Call) and name in ("CalibrationResult", "replace"):
                first = node.args[:1] if name == "CalibrationResult" else []
                given = [*first, *(k.value for k in node.keywords if k.arg == "kind")]
                given += [n for a in given if isinstance(a, ast.IfExp) for n in (a.body, a.orelse)]
                given += [constants[a.id] for a in given if isinstance(a, ast.Name) and a.id in constants]
                found |= {a.value for a in given if isinstance(a, ast.Constant)}
    return found


@pytest.mark.parametrize("file", OLD, ids=lambda f: f.stem)
def test_every_kind_has_a_page_that_answers_first(file: Path) -> None:
    result = read_result(file)
    page = report_page(result)
    kind = registry.KINDS[result.kind]
    assert f"<h1>{kind.title}</h1>" in page
    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", page)
    for fact in kind.headline(result):
        assert page.index(fact.name.replace(">", "&gt;")) < page.index("<main>")
    assert kind.headline(result)


def test_a_new_kind_is_one_registration(monkeypatch: pytest.MonkeyPatch) -> None:
    kind = Kind(
        "Stretch of a belt",
        lambda r: [Fact("stretch", f"{r.figures['stretch'].value} mm")],
        lambda r: f"The belt is known to {r.figures['stretch'].sigma} mm.",
        rows="belts",
        tables=lambda r: [TextTable("Rollers", (Column("roller"), Column("mm", True)), (("one", "1.5"),))],
    )
    monkeypatch.setattr(registry, "KINDS", {**registry.KINDS, "belt": kind})
    result = CalibrationResult("belt", "ok", (Check("a", "ok", "b"),), figures={"stretch": Measured(2.5, 0.1, "mm")})
    page = report_page(result)
    for text in (str(result), result.summary(), page, result._repr_html_()):
        assert "Stretch of a belt" in text
        assert "The belt is known to 0.1 mm." in text
    assert "stretch" in str(result)
    assert "Rollers" in result.summary()
    assert '<th scope="row">one</th><td class="n">1.5</td>' in page


def test_bars_stand_on_a_logarithmic_scale() -> None:
    block = bars("Loop", "mm", ["a", "b"], {"before": [100.0, None], "after": [0.1, 1.0]})
    assert block is not None
    heights = {bar["text"]: bar["height"] for bar in block.values["bars"]}
    assert len(heights) == 3
    # A decade is a decade: 0.1 to 1 mm as far as 1 to 10.
    assert heights["a, before: 100 mm"] / heights["b, after: 1 mm"] == pytest.approx(3, rel=0.01)
    assert bars("Loop", "mm", ["a"], {"before": [None]}) is None
