"""A grasp from the belt in a rendered cell, by the truth."""

from __future__ import annotations

import json

import pytest

from calibrant.studies.conveyor_cell import Passed, conveyor_json, conveyor_study

pytest.importorskip("mujoco")


@pytest.mark.long
def test_a_cube_that_moves_and_turns_is_held() -> None:
    (passed,) = conveyor_study([1])
    assert passed.held, passed.reason
    assert passed.sights > 10


@pytest.mark.long
@pytest.mark.xfail(reason="held 16 mm off the middle of the pads in this cell; the cause is not found", strict=False)
def test_it_is_held_by_its_middle() -> None:
    (passed,) = conveyor_study([1])
    assert passed.off_mm < 5.0


def test_the_table_says_what_was_not_held_and_why() -> None:
    nan = float("nan")
    runs = (
        Passed(0, 0, 0.1, 20.0, True, "", 0.6, 20, 3.4),
        Passed(0, 1, 0.2, -20.0, False, "the object was lost", nan, 3, 1.4),
    )
    data = json.loads(conveyor_json(runs))
    assert (data["held"], data["of"], data["passed"]) == (1, 2, False)
    assert data["runs"][1]["off_mm"] is None
    assert data["runs"][1]["reason"] == "the object was lost"
