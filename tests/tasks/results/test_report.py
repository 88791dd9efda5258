"""calibrant report with more than one result: the first one's page, with what differs in the others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.made_results import make_intrinsics

import calibrant as cb


def test_a_report_beside_another(tmp_path: Path) -> None:
    first = make_intrinsics()
    moved = replace(first.camera, values=first.camera.values + np.eye(9)[2])
    first.write(tmp_path / "monday.json")
    replace(first, cameras={"camera": moved}).write(tmp_path / "friday.json")
    cb.report(tmp_path / "monday.json", [tmp_path / "friday.json"], out=tmp_path / "both.html")
    page = (tmp_path / "both.html").read_text(encoding="utf-8")
    assert "Compared with friday.json" in page
    assert "Difference from friday.json over the image" in page
    found = cb.compare(tmp_path / "monday.json", tmp_path / "friday.json")
    for fact in ("difference", "implied rotation"):
        assert f"{found.figures[fact].value:.3g}" in page


def test_folders_are_named_where_they_are_asked_for(tmp_path: Path) -> None:
    first = replace(make_intrinsics(), inputs=({"file": "/home/ada/0.png", "sha256": "ab" * 32},))
    first.write(tmp_path / "a.json")
    for paths in (False, True):
        cb.report(tmp_path / "a.json", out=tmp_path / "a.html", paths=paths, force=True)
        assert ("/home/ada" in (tmp_path / "a.html").read_text(encoding="utf-8")) is paths


def test_another_that_has_nothing_in_common_is_refused(tmp_path: Path) -> None:
    first = make_intrinsics()
    first.write(tmp_path / "a.json")
    replace(first, cameras={}).write(tmp_path / "b.json")
    with pytest.raises(cb.InputError, match="no camera and no transform in common"):
        cb.report(tmp_path / "a.json", [tmp_path / "b.json"])
