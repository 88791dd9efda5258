"""points:DIR: a folder of own points, with the unit of its files."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrant.errors import InputError
from calibrant.targets.point_folder import PointFolder
from calibrant.targets.registry import parse_target


@pytest.mark.parametrize(("suffix", "metres"), [("", 1e-3), (":unit=m", 1.0), (":unit=in:scale=2.0", 0.0508)])
def test_a_spec_reads_back_with_its_unit(tmp_path: Path, suffix: str, metres: float) -> None:
    target = parse_target(f"points:{tmp_path}{suffix}")
    assert isinstance(target, PointFolder)
    assert target.metres == pytest.approx(metres, rel=1e-15)
    assert parse_target(target.spec) == target
    assert parse_target(target.scaled(1.5).spec).metres == pytest.approx(1.5 * metres)  # type: ignore[attr-defined]


def test_what_is_not_known_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="unknown unit 'ft'; known units: mm"):
        parse_target(f"points:{tmp_path}:unit=ft")
    with pytest.raises(InputError, match="there is no folder"):
        parse_target(f"points:{tmp_path}/none:unit=m")
    target = parse_target(f"points:{tmp_path}")
    with pytest.raises(InputError, match="files beside the images"):
        _ = target.points
    with pytest.raises(InputError, match="no artwork"):
        target.artwork()
