"""The terminal summary: complete, plain off a terminal, and inside 80 columns."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from calibrant.cameras import Camera, camera_model
from calibrant.data import CalibrationResult, Check, ViewResult
from calibrant.reports.parts.blocks import Column, TextTable
from calibrant.reports.terminal import summary, text_table


def _printed(result: CalibrationResult, *, width: int = 80, verbose: bool = False) -> str:
    stream = io.StringIO()
    Console(file=stream, width=width).print(summary(result, verbose=verbose))
    return stream.getvalue()


def test_intrinsics_shows_three_sigma_and_names_the_rms(intrinsics_result: CalibrationResult) -> None:
    text = _printed(intrinsics_result)
    assert any(line.split() == ["fx", "905.20", "0.26", "0.78", "px"] for line in text.splitlines())
    assert any(line.split() == ["k3", "0", "fixed"] for line in text.splitlines())
    assert "0.141 px  per point, both axes" in text
    assert "0.100 px  per axis" in text


def test_left_out_views_carry_their_reason(intrinsics_result: CalibrationResult) -> None:
    text = " ".join(_printed(intrinsics_result).split())
    assert "Views: 12 of 14 used" in text
    assert "left out: RMS 1.9 px, 9 times the others: the board moved" in text
    assert "54 (−2)" in text
    assert "left out: no board found" in text


def test_hand_eye_shows_both_transforms_methods_and_noise(hand_eye_result: Callable[[str], CalibrationResult]) -> None:
    text = _printed(hand_eye_result("eye-in-hand"), verbose=True)
    for expected in ("gripper → camera (T_gripper_camera)", "base → target (T_base_target)", "held-out error", "park"):
        assert expected in text
    assert "no answer: the rotation axes" in text
    assert any(line.split()[:4] == ["x", "30.00", "0.11", "mm"] for line in text.splitlines())
    assert "matrix, metres:" in text
    assert text.rstrip().splitlines()[-3].startswith("Verdict: GOOD.")


def test_what_passed_and_what_methods_give_is_folded(hand_eye_result: Callable[[str], CalibrationResult]) -> None:
    checks = tuple(Check(f"question-{i}", "ok", "fine") for i in range(9))
    asked = Check("workspace", "ok", "within the tolerance of 1 mm")
    doubt = Check("target-size", "warn", "measure the board")
    text = _printed(replace(hand_eye_result("eye-in-hand"), checks=(*checks, asked, doubt), verdict="warn"))
    assert "9 more checks passed; --verbose or the report shows them" in " ".join(text.split())
    assert "question-3" not in text
    assert "within the tolerance of 1 mm" in text
    assert "measure the board" in text
    assert "park" not in text
    assert text.index("T_gripper_camera") < text.index("Checks")
    few = _printed(replace(hand_eye_result("eye-in-hand"), checks=checks[:3]))
    assert "question-2" in few


@pytest.mark.parametrize("width", [80, 140])
def test_no_line_is_wider_than_the_terminal(
    width: int, intrinsics_result: CalibrationResult, hand_eye_result: Callable[[str], CalibrationResult]
) -> None:
    for result in (intrinsics_result, hand_eye_result("eye-to-hand")):
        assert max(len(line) for line in _printed(result, width=width).splitlines()) <= width
        assert "…" not in _printed(result, width=width)


def test_a_wide_terminal_puts_the_transforms_side_by_side(hand_eye_result: Callable[[str], CalibrationResult]) -> None:
    lines = _printed(hand_eye_result("eye-to-hand"), width=140).splitlines()
    assert any("T_base_camera" in line and "T_gripper_target" in line for line in lines)


def test_output_is_plain_when_it_is_not_a_terminal(intrinsics_result: CalibrationResult) -> None:
    assert "\x1b" not in _printed(intrinsics_result)


def test_names_with_brackets_are_not_markup(intrinsics_result: CalibrationResult) -> None:
    views = (ViewResult("[red]a[/red].png", True, 4, 0.1, reason="[bold] odd"),)
    text = _printed(replace(intrinsics_result, views=views))
    assert "[red]a[/red].png" in text
    assert "[bold] odd" in text


def test_many_views_show_only_those_worth_a_look(intrinsics_result: CalibrationResult) -> None:
    views = tuple(ViewResult(f"{i}.png", True, 54, 0.1 + 0.001 * i) for i in range(300))
    text = _printed(replace(intrinsics_result, views=views))
    assert "299.png" in text
    assert "100.png" not in text
    assert "295 more views used without remark" in text


def test_a_result_with_nothing_but_a_verdict() -> None:
    assert "Verdict: DO NOT USE" in _printed(CalibrationResult("intrinsics", "refused"))


def test_a_surface_of_control_points_is_summed_up(intrinsics_result: CalibrationResult) -> None:
    kind = camera_model("splined:16x12:120deg")
    values = kind.starting_values(700.0, np.array([640.0, 512.0]))
    variance = np.full(len(values), 0.002**2)
    variance[:4], variance[-1] = 0.0, 0.05**2
    camera = Camera(kind, (1280, 1024), values, np.diag(variance))
    text = _printed(replace(intrinsics_result, cameras={"camera": camera}))
    assert "and 384 more, x0_0 to y11_15, in the result file" in " ".join(text.split())
    assert "their 1σ is 0.0020 (median) to 0.050 (worst)" in " ".join(text.split())
    assert "x5_5" not in text
    assert any(line.split()[:2] == ["fx", "700.00"] for line in text.splitlines())


@pytest.mark.parametrize("width", [60, 80, 140])
def test_a_narrow_terminal_breaks_headings_and_names_and_cuts_no_word(width: int) -> None:
    headings = ("capture", "corners", "in the projector", "RMS, px", "of them decoded", "direct light")
    columns = tuple(Column(heading, k > 0) for k, heading in enumerate(headings))
    rows = (("board-in-the-far-corner", "63", "60", "0.200", "100%", "30%"),)
    stream = io.StringIO()
    Console(file=stream, width=width).print(text_table(TextTable("Captures", columns, rows)))
    lines = stream.getvalue().splitlines()
    assert {word for h in headings for word in h.split()} <= set(" ".join(lines).split())
    assert "".join(line[: max(7, line.find("  "))].strip() for line in lines[-4:]).endswith(rows[0][0])
    assert set(rows[0][1:]) <= set(" ".join(lines).split())
    assert max(map(len, lines)) <= width
