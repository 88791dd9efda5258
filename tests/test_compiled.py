"""Compiled functions: right, refused for other types, and loaded without what only a compilation needs."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from docs.house import parsed
from numba import types
from tests.detection.chessboard_pictures import Lens, facing, picture

import calibrant
from calibrant.compiled import compiled, compiled_for_pointer, compiled_part

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


@compiled_part(types.float64(types.float64))
def half(value):  # type: ignore[no-untyped-def]
    return 0.5 * value


@compiled_for_pointer(types.float64(types.float64))
def quarter(value):  # type: ignore[no-untyped-def]
    return half(half(value))


def test_it_computes_what_it_says() -> None:
    assert scaled_sum(np.array([1.0, 2.0]), 2.0) == 1.5
    assert scaled_sum(np.array([1.0]), 0.0) == np.inf


def test_other_types_are_refused() -> None:
    with pytest.raises(TypeError):
        scaled_sum(np.array(["a"]), 1.0)


def test_a_part_has_no_way_in_from_python() -> None:
    assert quarter(8.0) == 2.0
    with pytest.raises(TypeError):
        half(8.0)


@pytest.mark.long
def test_asserts_and_docstrings_do_not_matter_to_the_cache() -> None:
    script = (
        "from numba.core import event\n"
        "class Compilations(event.Listener):\n"
        "    def on_start(self, e): print(e.data['dispatcher'].py_func.__qualname__)\n"
        "    def on_end(self, e): pass\n"
        "event.register('numba:compile', Compilations())\n"
        "import calibrant.optimize.linear_kernels\n"
    )
    for flags in ([], ["-O"], ["-OO"]):  # the first may have to compile
        done = subprocess.run([sys.executable, *flags, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == ""


def test_numba_is_inside_as_it_was() -> None:
    """What calibrant/compiled.py and the reprojection's kernels reach into: where this fails, a release of Numba has
    moved it, and they must follow before pyproject.toml lets that release in."""
    from numba.core.caching import FunctionCache
    from numba.core.registry import CPUDispatcher
    from numba.core.runtime import rtsys
    from numba.core.target_extension import current_target
    from numba.experimental.function_type import _get_wrapper_address

    assert current_target() == "cpu"
    assert isinstance(quarter, CPUDispatcher), "njit makes another kind of object"
    assert isinstance(quarter._cache, FunctionCache), "a dispatcher keeps its cache elsewhere"
    assert hasattr(quarter.targetctx, "refresh"), "a dispatcher keeps its target context elsewhere"
    assert callable(rtsys.initialize), "the runtime is made ready in another way"
    assert callable(CPUDispatcher._insert), "calls from Python are looked up in another way"
    (result,) = quarter.overloads.values()
    key = FunctionCache(quarter.py_func)._index_key(result.signature, quarter.targetctx.codegen())
    signature, _, (_, closure) = key
    assert (signature, len(closure)) == (result.signature, 64), "the cache's key has another form"
    assert _get_wrapper_address(quarter, result.signature) > 0, "functions have no address to call them at"


def test_a_function_in_the_cache_loads_without_the_compiler() -> None:
    """Numba's array functions bring SciPy's linear algebra: a sign of all that a compilation asks for."""
    script = "import sys, calibrant.optimize.linear_kernels; print('scipy.linalg' in sys.modules)"
    for _ in range(2):  # the first may have to compile
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


@pytest.mark.long
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


def compiled_functions() -> Iterator[tuple[str, ast.FunctionDef]]:
    """Every kernel, as it is written, with the name of its file."""
    for file in PACKAGE.rglob("*.py"):
        for node in ast.walk(parsed(file)):
            decorators = [ast.unparse(d) for d in getattr(node, "decorator_list", ())]
            if isinstance(node, ast.FunctionDef) and any(d.startswith(("compiled", "njit")) for d in decorators):
                yield file.name, node


@pytest.mark.long
def test_kernels_are_compiled_once_and_without_sentences(tmp_path: Path) -> None:
    """A first run waits for each: for one of several types, and for strings, which an error's sentence brings."""
    script = (
        "from numba.core import event\n"
        "class Compilations(event.Listener):\n"
        "    def on_start(self, e):\n"
        "        f = e.data['dispatcher'].py_func\n"
        "        print(f'{f.__module__}.{f.__qualname__}')\n"
        "    def on_end(self, e): pass\n"
        "event.register('numba:compile', Compilations())\n"
        "import calibrant.calibrate.classical.planar_kernels\n"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    compiled_now = done.stdout.split()
    own = [name for name in compiled_now if name.startswith("calibrant.")]
    assert len(own) == 4
    assert len(set(own)) == 4
    assert len(compiled_now) <= 12
    assert not [name for name in compiled_now if ".unicode." in name or "raise_with" in name]


@pytest.mark.long
def test_what_kernels_call_are_parts() -> None:
    """A part comes from the cache even where it was just compiled, so that its callers are alike in every process."""
    entries = [
        (file, f.name) for file, f in compiled_functions() if ast.unparse(f.decorator_list[0]).startswith("compiled(")
    ]
    called = {
        f"{file}: {function.name} calls {node.func.id}"
        for file, function in compiled_functions()
        for node in ast.walk(function)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and (file, node.func.id) in entries
    }
    assert len(entries) > 20
    assert not called


@pytest.mark.long
def test_kernels_copy_arrays_by_element() -> None:
    found = []
    for file, function in compiled_functions():
        for node in ast.walk(function):
            if not isinstance(node, ast.Assign) or isinstance(node.value, ast.Constant):
                continue
            for target in node.targets:
                parts = ast.walk(target.slice) if isinstance(target, ast.Subscript) else ()
                if any(isinstance(part, ast.Slice) for part in parts) and ast.unparse(node.value) != "np.nan":
                    found.append(f"{file}: {function.name}: {ast.unparse(node)}")
    assert not found


@pytest.mark.long
def test_where_sums_may_be_reordered_there_is_no_power() -> None:
    found = []
    for file in PACKAGE.rglob("*.py"):
        for node in ast.walk(parsed(file)):
            if isinstance(node, ast.FunctionDef) and any("fastmath" in ast.unparse(d) for d in node.decorator_list):
                found += [f"{file.name}: {node.name}" for part in ast.walk(node) if isinstance(part, ast.Pow)]
    assert not found
