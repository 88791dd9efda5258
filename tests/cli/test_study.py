"""calibrant study methods: what it says of exact, noisy and degenerate points, what it writes, what it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.studies import methods as study_methods
from calibrant.studies import sweeps as study_sweeps
from calibrant.studies.methods import USES, Outcome
from calibrant.studies.page import SHORT, Compared, Study, page, tables
from calibrant.studies.scenes import Conditions, lens_of, plane_case, plane_points, solid_case, solid_points

EXACT = Conditions(noise_px=0.0, lens="pinhole", views=4)


def sweep_of(title: str, conditions: Conditions, *values: float) -> dict[tuple[str, str], tuple[Outcome, ...]]:
    """Outcomes of a sweep's methods at the given values, by what they need and their name."""
    from dataclasses import replace

    one = next(s for s in study_sweeps.SWEEPS if s.title == title)
    found = study_sweeps.sweep(replace(one, values=values), conditions, trials=2, step=lambda: None)
    return {(r.use, r.method): r.outcomes for r in found.rows}


@pytest.mark.parametrize("method", study_methods.methods(), ids=lambda m: f"{m.name}, {m.use}")
def test_every_method_is_exact_on_exact_points(method: study_methods.Method) -> None:
    case = solid_case(EXACT) if method.use == "depth, one view" else plane_case(EXACT)
    for outcome in study_methods.runs(method, case):
        assert outcome.refused is None, outcome.message
        # The full solution stops where a step gains nothing that pixels show: 1e-6 %.
        assert abs(outcome.focal_percent or 0) < 1e-6
        assert (outcome.rms_px or 0) < 1e-6
        assert (outcome.position_mm or 0) < 1e-5


@pytest.mark.parametrize(
    ("title", "value", "use", "method", "name"),
    [
        ("Depth of the target", 0, "depth, one view", "DLT", "coplanar points"),
        ("Depth of the target", 0, "depth, one view", "Tsai, with depth", "coplanar points"),
        ("Tilt of a plane", 0, "plane, one view", "Tsai, division", "fronto-parallel"),
        ("Tilt of a plane", 0, "plane, one view", "fast RAC", "fronto-parallel"),
        ("Tilt of a plane", 0, "plane, one view", "Zhang, one view", "fronto-parallel"),
        ("t_y of the target's origin", 0, "plane, one view", "Tsai, brown", "t_y = 0"),
        ("t_y of the target's origin", 0, "plane, one view", "fast RAC", "t_y = 0"),
        ("t_y of the target's origin", 0, "depth, one view", "Tsai, with depth", "t_y = 0"),
        ("Number of points", 4, "plane, one view", "Tsai, inverse_brown", "too few points"),
        ("Number of points", 5, "depth, one view", "DLT", "too few points"),
        ("Number of points", 6, "depth, one view", "Tsai, with depth", "too few points"),
    ],
)
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_failures_have_their_names_with_and_without_noise(
    title: str, value: float, use: str, method: str, name: str, noise: float
) -> None:
    conditions = Conditions(noise_px=noise, lens="pinhole")
    outcome = sweep_of(title, conditions, value)[use, method][0]
    assert outcome.refused == name
    assert name in SHORT or name == "t_y = 0"
    assert outcome.message is not None
    assert outcome.message.startswith(f"{name}: ")


def test_parallel_views_are_refused() -> None:
    outcome = sweep_of("Tilt of a plane", EXACT, 0)["plane, all views", "Zhang"][0]
    assert outcome.refused == "parallel planes"


def test_errors_grow_with_the_noise_and_the_full_solution_is_best_of_all_views() -> None:
    rows = sweep_of("Noise", Conditions(lens="brown:-0.1"), 0.05, 0.5)
    for outcomes in rows.values():
        low, high = (o.rms_px for o in outcomes)
        assert low is not None
        assert high is not None
        assert low < high
    many = {name: o[1].focal_percent for (use, name), o in rows.items() if use == "plane, all views"}
    assert min(many, key=lambda n: many[n] or np.inf) == "full solution"


def test_targets_have_about_the_points_asked_for() -> None:
    assert plane_points(63).shape == (63, 3)
    for count in (9, 40, 63, 200, 1000):
        points = plane_points(count)
        assert 0.5 * count <= len(points) <= 1.3 * count
        assert np.any(np.all(np.abs(points) < 1e-12, axis=1))  # the origin that fast calibration needs
    assert np.ptp(solid_points(60, depth=0.0)[:, 2]) == 0
    assert np.ptp(solid_points(60, depth=1.0)[:, 2]) > 0.05


@pytest.mark.parametrize("spec", ["brown:much", "pinhole:0.1", "kannala_brandt:inf", "unified:0.1"])
def test_a_lens_without_such_a_term_is_named(spec: str) -> None:
    with pytest.raises(InputError, match=r"--lens .*: expected a model with a radial term"):
        lens_of(spec, centre=np.array([600.0, 500.0]))


def figures(path: Path) -> dict[str, Any]:
    document = json.loads(path.read_text(encoding="utf-8"))
    assert isinstance(document, dict)
    return document


@pytest.mark.long
def test_the_command_prints_and_writes_every_figure(calibrant, tmp_path: Path) -> None:
    out, report = tmp_path / "study.json", tmp_path / "study.html"
    done = calibrant("study", "methods", "--trials", 1, "--views", 3, "--out", out, "--report", report)
    assert (done.status, done.err) == (0, "")
    for words in ("Tsai, division", "DLT", "Zhang, with skew", "full solution", "coplanar", "facing", "t_y = 0"):
        assert words in done.out
    assert max(len(line) for line in done.out.splitlines() if not line.startswith("Written")) <= 80
    document = figures(out)
    assert document["format"] == "calibrant-study/1"
    assert {m["use"] for m in document["methods"]} == set(USES)
    assert [s["condition"] for s in document["sweeps"]] == [s.title for s in study_sweeps.SWEEPS]
    assert report.read_text(encoding="utf-8").count("<svg") == len(study_sweeps.SWEEPS)
    again = calibrant("study", "methods", "--out", out)
    assert again.status == 2
    assert "exists already" in again.err


def test_json_goes_alone_to_standard_output_and_repeats_with_its_seed(calibrant) -> None:
    runs = [calibrant("study", "methods", "--trials", 0, "--views", 2, "--seed", s, "--json") for s in (3, 3, 4)]
    documents = [json.loads(r.out) for r in runs]

    def errors(document: dict[str, Any]) -> list[object]:
        return [m.get("focal_percent", m.get("refused")) for m in document["methods"]]

    assert errors(documents[0]) == errors(documents[1]) != errors(documents[2])
    assert documents[0]["sweeps"] == []


def test_own_points_are_compared_with_the_full_solution(calibrant, found: Path) -> None:
    done = calibrant("study", "methods", "--observations", found)
    assert (done.status, done.err) == (0, "")
    assert "against the full solution of all views" in done.out
    assert "Tsai, division" in done.out
    assert "DLT" not in done.out  # the board is flat


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--noise", "0.1"], "--noise takes a length in pixels with its unit"),
        (["--noise", "100px"], "points this noisy change places"),
        (["--points", "4"], "--points 4: a simulated target has 9 to 10000 points"),
        (["--views", "0"], "--views 0: simulate 1 to 1000 views"),
        (["--trials", "-1"], "--trials -1"),
        (["--lens", "glass"], "glass"),
        (["photo.png"], "photos need the board they show: --target"),
    ],
)
def test_unusable_arguments_are_named(calibrant, arguments: list[str], words: str) -> None:
    done = calibrant("study", "methods", *arguments)
    assert done.status == 2
    assert words in done.err


def test_a_method_that_every_view_refuses_says_why_in_its_row() -> None:
    from io import StringIO

    from rich.console import Console

    method = study_methods.methods()[0]
    refused = Outcome(refused="fronto-parallel", message="fronto-parallel: no tilt")
    study = Study("views", "truth", {}, (Compared(method, refused, 3, 3),), ())
    console = Console(file=StringIO(), width=80)
    console.print(tables(study))
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert "3/3" in text
    assert "facing: fronto-parallel: no tilt" in text
    assert "fronto-parallel" in page(study)
