"""Folders of the user's machine are in no report, unless asked for."""

from __future__ import annotations

from dataclasses import replace

import pytest

from calibrant.data import CalibrationResult, Check
from calibrant.reports.html import report_page
from calibrant.reports.nameless import without_folders


def named(result: CalibrationResult, folder: str) -> CalibrationResult:
    seen = result.observations
    assert seen is not None
    views = tuple(replace(v, file=f"{folder}{v.id}") for v in seen.views)
    return replace(
        result,
        inputs=tuple({"file": v.file or "", "sha256": "ab" * 32} for v in views),
        checks=(*result.checks, Check("read", "warn", f"{folder}0.png is dark, see {folder}notes.txt")),
        options={**result.options, "camera": f"{folder}camera.json"},
        notes=(f"read from {folder}poses.csv",),
        observations=replace(seen, views=views),
    )


@pytest.mark.parametrize("folder", ["/home/ada/my robot, cell/", "C:\\Users\\ada\\cell\\", "../../ada/", "~/ada/"])
def test_a_page_has_no_folders(intrinsics_result: CalibrationResult, folder: str) -> None:
    result = named(intrinsics_result, folder)
    page = report_page(result)
    assert "ada" not in page
    assert "notes.txt" in page
    assert page.count("0.png") > 2
    assert "ada" in report_page(result, paths=True)


def test_all_else_stays(intrinsics_result: CalibrationResult) -> None:
    """Units, fractions, names of frames, relative paths and markup are no absolute paths."""
    texts = ("1/2 px", "km/h and/or", "photos/0.png", "</script><img>", "base/camera", "https://example.org/x")
    checks = tuple(Check(text, "ok", text) for text in texts)
    assert without_folders(replace(intrinsics_result, checks=checks)).checks == checks
    same = without_folders(intrinsics_result)
    assert same is intrinsics_result
