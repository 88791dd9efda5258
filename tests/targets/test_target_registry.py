"""Specs in YAML files."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrant.errors import InputError
from calibrant.targets.registry import parse_target

SPEC = "charuco:5x7:40mm:20mm:DICT_6X6_250"


@pytest.mark.parametrize("line", [SPEC, f'"{SPEC}"', f"'{SPEC}'", f"{SPEC}  # the one on the wrist"])
def test_a_yaml_file_names_its_target(tmp_path: Path, line: str) -> None:
    path = tmp_path / "board.yaml"
    path.write_text(f"# printed in May\nserial: 7\ntarget: {line}\nnote: other keys are left alone\n")
    assert parse_target(str(path)).spec == SPEC


def test_a_chessboard_is_read() -> None:
    pytest.importorskip("calibrant.targets.chessboard")
    target = parse_target("chessboard:9x6:25mm")
    assert (target.kind, len(target.points)) == ("chessboard", 54)


def test_a_chessboard_needs_two_fields() -> None:
    pytest.importorskip("calibrant.targets.chessboard")
    with pytest.raises(InputError, match="needs a size and a length"):
        parse_target("chessboard:9x6")


def test_faults_of_a_yaml_file_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        parse_target(str(tmp_path / "missing.yaml"))
    empty = tmp_path / "empty.yml"
    empty.write_text("targets: 3\n")
    with pytest.raises(InputError, match="no line `target: SPEC`"):
        parse_target(str(empty))
    binary = tmp_path / "binary.yml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="cannot be read as text"):
        parse_target(str(binary))
    wrong = tmp_path / "wrong.yml"
    wrong.write_text("target: charuco:5x7\n")
    with pytest.raises(InputError, match=r"wrong\.yml: target"):
        parse_target(str(wrong))


def test_squares_that_are_not_square_have_two_lengths() -> None:
    target = parse_target("chessboard:9x6:25mm:24.5mm")
    assert target.points[-1].tolist() == pytest.approx([0.2, 0.1225, 0.0])
    assert target.spec == "chessboard:9x6:25mm:24.5mm"
    assert parse_target(target.spec) == target
    assert target.scaled(2.0).spec == "chessboard:9x6:50mm:49mm"
    x0, y0, x1, y1 = target.artwork().bounds
    assert (x1 - x0, y1 - y0) == pytest.approx((12 * 0.025, 9 * 0.0245))
    assert parse_target("chessboard:8x8:25mm").turns_unnoticed_deg == 90  # type: ignore[attr-defined]
    assert parse_target("chessboard:8x8:25mm:24mm").turns_unnoticed_deg == 180  # type: ignore[attr-defined]
    with pytest.raises(InputError, match=r"such as chessboard:9x6:25mm, or chessboard:9x6:25mm:24\.5mm"):
        parse_target("chessboard:9x6:25mm:24mm:3mm")


def test_rows_of_circles_have_a_spacing_of_their_own() -> None:
    target = parse_target("circles:10x8:25mm:bigdot:down=24.9mm")
    assert target.points[-1].tolist() == pytest.approx([0.225, 7 * 0.0249, 0.0])
    assert parse_target(target.spec) == target
    assert parse_target("circles:10x10:25mm:down=24mm").turns_unnoticed_deg == 180  # type: ignore[attr-defined]
    assert parse_target("circles:7x11:40mm:asymmetric:down=39mm").scaled(0.5).spec.endswith(":down=19.5mm")
