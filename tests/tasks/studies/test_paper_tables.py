"""`calibrant study paper-tables` without a cell, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from calibrant.errors import InputError
from calibrant.tasks.options.cell import CellOptions
from calibrant.tasks.studies.paper_tables import Request, run


def test_without_a_cell_it_gives_the_papers_own_tables() -> None:
    answer = run(Request()).answer
    assert answer is not None
    data = json.loads(answer.text())
    pairs = {d["pair"]: d for d in data["paper"]["distances"]}
    assert pairs["PA-PB"] == {"pair": "PA-PB", "camera_mm": 33.985, "base_mm": 36.537}
    assert "runs" not in data
    assert "2.55 mm" in data["verdict"]


@pytest.mark.parametrize(
    ("request_", "said"),
    [
        (Request(cells=CellOptions(cell=True, view="top")), "moves its camera"),
        (Request(readings=0), "--readings 0"),
        (Request(plot=Path("x.png")), "give --cell"),
        (Request(cells=CellOptions(cell=True, seeds=0)), "--seeds 0"),
    ],
)
def test_what_cannot_be_is_refused(request_: Request, said: str) -> None:
    with pytest.raises(InputError, match=said):
        run(request_)
