"""`verify … --cell`: one simulated cell, from its own pictures to a table of runs."""

from __future__ import annotations

import contextlib
import io
import json

import pytest
from tests.simulate.robot_cell.cells import needs_opengl

from calibrant.cli.application import run


def said(*arguments: str) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = run(["verify", *arguments])
    return status, out.getvalue(), err.getvalue()


@needs_opengl()
@pytest.mark.long
def test_a_pinpoint_in_one_cell_as_data() -> None:
    status, out, err = said("pinpoint", "--cell", "--view", "top", "--seeds", "1", "--first-seed", "40", "--json")
    assert status == 0, err
    found = json.loads(out)
    assert [row["seed"] for row in found["runs"]] == [40]
    assert list(found["runs"][0])[:4] == ["seed", "error_mm", "predicted_95_mm", "passed"]
    assert found["median_mm"] == found["runs"][0]["error_mm"] < 3.0  # what is promised of the top camera
    assert found["runs"][0]["after_deg"] < 0.3
    assert found["passed"] is True
    assert found["inside_95"] == 1


def test_what_does_not_go_with_a_cell_is_said() -> None:
    status, _, err = said("pinpoint", "--cell", "--images", "x.png")
    assert status == 2
    assert "leave the result, the photos and the offsets out" in err
    status, _, err = said("pinpoint")
    assert status == 2
    assert "--cell" in err


@needs_opengl()
@pytest.mark.long
def test_a_cube_is_set_on_another_in_one_cell() -> None:
    options = ("--cell", "--view", "top", "--seeds", "1", "--first-seed", "40", "--cubes", "1", "--json")
    status, out, err = said("pick-place", *options)
    assert status == 0, err
    found = json.loads(out)
    assert found["runs"][0]["passed"] is True
    assert found["runs"][0]["error_mm"] < 5.0
    assert len(found["beside"]) == 2


def test_pick_and_place_without_a_robot_is_said() -> None:
    status, _, err = said("pick-place")
    assert status == 2
    assert "give --cell" in err
    assert said("pick-place", "--cell", "--cubes", "0")[0] == 2


@needs_opengl()
@pytest.mark.long
def test_a_push_is_named_in_one_cell() -> None:
    status, out, err = said("watch", "--cell", "--view", "front", "--seeds", "1", "--first-seed", "40", "--json")
    assert status == 0, err
    run = json.loads(out)["runs"][0]
    assert run["passed"] is True
    assert run["reason"].startswith("named by picture")
    assert run["error_mm"] < 1.0  # of a push by 1 mm: it is known better than it is large
