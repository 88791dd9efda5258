"""Compiled functions: right, refused for other types, and loaded without what only a compilation needs."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from numba import types
from tests.detection.chessboard_pictures import Lens, facing, picture

import calibrant
from calibrant.compiled import compiled

PACKAGE = Path(calibrant.__file__).parent
CORNERS = """
import sys, numpy as np
from calibrant import detect, parse_target
(view,) = detect([sys.argv[1]], target=parse_target("chessboard:9x6:25mm")).views
print(view.uv.tobytes().hex(), view.sigma_px.tobytes().hex())
"""


@compiled(types.float64(types.float64[::1], types.float64))
def scaled_sum(values, divisor):  # type: ignore[no-untyped-def]
    total = 0.0
    for v in values:
        total += v
    return total / divisor


def test_it_computes_what_it_says() -> None:
    assert scaled_sum(np.array([1.0, 2.0]), 2.0) == 1.5
    assert scaled_sum(np.array([1.0]), 0.0) == np.inf


def test_other_types_are_refused() -> None:
    with pytest.raises(TypeError):
        scaled_sum(np.array(["a"]), 1.0)


def test_a_function_in_the_cache_loads_without_the_compiler() -> None:
    """Numba's array functions bring SciPy's linear algebra: a sign of all that a compilation asks for."""
    script = "import sys, calibrant.optimize.linear_kernels; print('scipy.linalg' in sys.modules)"
    for _ in range(2):  # the first may have to compile
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


@pytest.mark.parametrize("of_another_process", ["saddle._linearise", "saddle._normal_equations"])
def test_machine_code_of_several_processes_gives_the_same_digits(tmp_path: Path, of_another_process: str) -> None:
    """What is compiled anew is linked with what an earlier process left in the cache."""
    lens = Lens(290.0, 160.0, 120.0)
    pose = facing(9, 6, lens, distance=15, tilt_deg=20, axis_deg=30, roll_deg=5)
    image = tmp_path / "board.png"
    cv2.imwrite(str(image), picture(9, 6, pose, lens, (320, 240), seed=0))
    copy = tmp_path / "calibrant"
    digits = []
    for package in (PACKAGE, copy):
        if package is copy:
            # Other tests compile meanwhile: what is half written has another name, and is gone a moment later.
            shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("*.tmp.*", "*.pyc.*"))
            stale = list((copy / "detection" / "subpixel" / "__pycache__").glob(f"{of_another_process}[.-]*.nb*"))
            assert stale
            for file in stale:
                file.unlink()
        environment = {**os.environ, "PYTHONPATH": str(package.parent)}
        command = [sys.executable, "-c", CORNERS, str(image)]
        digits.append(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)
    assert len(digits[0]) > 1000
    assert digits[0] == digits[1]


def test_where_sums_may_be_reordered_there_is_no_power() -> None:
    found = []
    for file in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.FunctionDef) and any("fastmath" in ast.unparse(d) for d in node.decorator_list):
                found += [f"{file.name}: {node.name}" for part in ast.walk(node) if isinstance(part, ast.Pow)]
    assert not found
