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
