"""Files that the docs show are read by the commands they are shown for."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from calibrant.formats.poses.joint_columns import joint_values, joints_of_robot
from calibrant.formats.poses.read import read_table
from calibrant.formats.robots.read import read_robot
from calibrant.targets.bundle import Bundle
from calibrant.targets.registry import parse_target
from calibrant.tasks.inputs.columns import read_columns

DOCS = Path(__file__).parents[2] / "docs"


def sample(name: str, folder: Path) -> Path:
    text = (DOCS / "file-formats.md").read_text(encoding="utf-8")
    found = re.search(rf"<!-- sample {re.escape(name)} -->\n```csv\n(.*?)```", text, re.S)
    assert found is not None
    (folder / name).write_text(found.group(1), encoding="utf-8")
    return folder / name


@pytest.mark.parametrize(
    ("name", "columns", "rows"), [("tip.csv", ("u", "v"), 3), ("features.csv", ("u", "v", "x_mm", "y_mm", "z_mm"), 3)]
)
def test_tables_of_pixels(tmp_path: Path, name: str, columns: tuple[str, ...], rows: int) -> None:
    assert read_columns(sample(name, tmp_path), columns).values.shape == (rows, len(columns))


def test_measurements(tmp_path: Path) -> None:
    table, _ = read_table(sample("tracker.csv", tmp_path))
    chain = read_robot("ur5e").chain
    q, _ = joint_values(table, joints_of_robot(table.header, chain), chain, angle="auto")
    assert q.shape == (2, 6)
    assert abs(q).max() < 4  # radians


def test_a_bundle(tmp_path: Path) -> None:
    text = (DOCS / "detection.md").read_text(encoding="utf-8")
    found = re.search(r"```yaml\n(target: bundle.*?)```", text, re.S)
    assert found is not None
    (tmp_path / "plate.yaml").write_text(found.group(1), encoding="utf-8")
    target = parse_target(str(tmp_path / "plate.yaml"))
    assert isinstance(target, Bundle)
    assert [i for i, _ in target.markers] == [3, 4, 10, 11, 12, 13, 14]
