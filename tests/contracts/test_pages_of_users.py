"""The pages for those who come from elsewhere: every line that they say to type runs, on files as they have."""

from __future__ import annotations

import importlib.util
import re
import shlex
import sys
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import calibrant as cb
from calibrant.cli.application import run

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted((ROOT / "docs").glob("from-*.md"))
LINE = re.compile(r"^ {4}(calibrant [a-z].*)$", re.MULTILINE)
BLOCK = re.compile(r"^```python\n(.*?)^```", re.M | re.S)


def doors() -> ModuleType:
    """The contract's maker of photos and poses."""
    spec = importlib.util.spec_from_file_location("doors_of_pages", Path(__file__).with_name("doors.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """photos/, poses.csv, camera.json; and the poses as each maker's controller has them."""
    folder = tmp_path_factory.mktemp("pages")
    files = doors().make_files(folder)
    files.images.rename(folder / "photos")
    T = cb.read_poses(files.poses)[0].T_base_gripper
    (folder / "zivid").mkdir()
    lines: dict[str, list[str]] = {"kuka.txt": [], "ur.txt": [], "fanuc.csv": []}
    for i, pose in enumerate(T):
        rotation, t = Rotation.from_matrix(pose[:3, :3]), pose[:3, 3]
        x, y, z = (1e3 * t).tolist()
        a, b, c = rotation.as_euler("ZYX", degrees=True).tolist()
        w, p, r = rotation.as_euler("xyz", degrees=True).tolist()
        lines["kuka.txt"].append(f"{{X {x:.6f}, Y {y:.6f}, Z {z:.6f}, A {a:.6f}, B {b:.6f}, C {c:.6f}}}")
        lines["ur.txt"].append(f"p[{', '.join(f'{v:.9f}' for v in [*t, *rotation.as_rotvec()])}]")
        lines["fanuc.csv"].append(f"{x:.6f},{y:.6f},{z:.6f},{w:.6f},{p:.6f},{r:.6f}")
        matrix = pose.copy()
        matrix[:3, 3] *= 1e3
        text = f"__version__:\n  serializer: 1\n  data: 1\nFloatMatrix:\n  Data:\n    {matrix.tolist()}\n"
        (folder / "zivid" / f"pos{i:02d}.yaml").write_text(text)
    for name, rows in lines.items():
        (folder / name).write_text("\n".join(rows))
    return folder


@pytest.mark.long
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_line_of_the_page_runs(page: Path, given: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(given)
    text = page.read_text(encoding="utf-8")
    typed = LINE.findall(text)
    assert typed
    for line in typed:
        words = shlex.split(line)[1:]
        names = [str(f) for word in words for f in (sorted(given.glob(word)) if "*" in word else [word])]
        force = ["--force"] if {"--out", "convert"} & set(words) else []
        assert run([*names, *force]) == 0, line


@pytest.mark.long
def test_python_on_the_pages_runs(given: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(given)
    found = cb.detect("photos/*.png", target="chessboard:7x6:30mm")
    names = {"object_points": [v.points for v in found.views], "image_points": [v.uv for v in found.views]}
    blocks = [block for page in PAGES for block in BLOCK.findall(page.read_text(encoding="utf-8"))]
    assert blocks
    for block in blocks:
        exec(compile(block, "page", "exec"), names)
    assert np.isfinite(names["sigma"])
    assert cv2.imread("photos/00.png") is not None
