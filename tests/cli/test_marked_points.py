"""Outliers in two steps, a camera's name, and what the result says of each view's worst point."""

from __future__ import annotations

import json
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def marked(calibrant, found: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("marked") / "first.json"
    done = calibrant(
        "intrinsics", "--observations", found, "--mark-outliers", "0.015px", "--name", "wrist", "--out", out
    )
    assert done.status == 0
    assert "marked" in done.out
    return out


def test_marked_points_are_left_out_of_the_next_run(calibrant, found: Path, marked: Path) -> None:
    first = json.loads(marked.read_text())
    points = first["details"]["marked_points"]["points"]
    count = sum(map(len, points.values()))
    used = sum(v["points"] for v in first["views"])
    assert 0 < count < used
    done = calibrant("intrinsics", "--observations", found, "--without-marked", marked, "--json")
    second = json.loads(done.out)
    assert sum(v["points"] + v.get("points_left_out", 0) for v in second["views"]) == used - count
    assert second["rms_px"] < first["rms_px"]
    refused = calibrant("intrinsics", "--observations", found, "--without-marked", found)
    assert (refused.status, "has no marked points" in refused.err) == (2, True)


def test_each_view_has_its_smallest_and_largest_error(marked: Path) -> None:
    for view in json.loads(marked.read_text())["views"]:
        assert 0 <= view["min_px"] <= view["rms_px"] <= view["max_px"]


def test_a_named_camera_is_called_so_everywhere(calibrant, cell, found: Path, marked: Path, tmp_path: Path) -> None:
    result = json.loads(marked.read_text())
    assert list(result["cameras"]) == ["wrist"]
    assert list(result["observations"]["image_sizes"]) == ["wrist"]
    out = tmp_path / "hand-eye.json"
    done = calibrant(
        *("hand-eye", "--observations", found, "--poses", cell.poses, "--camera", marked, "--name", "eye", "--out", out)
    )
    assert done.status == 0, done.err
    placed = json.loads(out.read_text())
    assert [(t["parent"], t["child"]) for t in placed["transforms"]] == [("gripper", "eye"), ("base", "target")]
    assert placed["joint_covariance"]["frames"][0] == ["gripper", "eye"]
    # Every later step finds it under its name.
    asked = calibrant("report", out, "--workspace", "300mm:500mm,-100mm:100mm,0mm:50mm", "--out", tmp_path / "p.html")
    assert (asked.status, "gripper → eye" in asked.out) == (0, True), asked.err
    for name in ("two words", "base"):
        assert calibrant("hand-eye", "--observations", found, "--poses", cell.poses, "--name", name).status == 2
