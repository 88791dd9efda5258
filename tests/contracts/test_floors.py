"""The floors of the house: a package imports from lower floors only, wherever in a file the import stands."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from docs.house import parsed

import calibrant

PACKAGE = Path(calibrant.__file__).parent
FLOOR = {
    "advice": 0,
    "errors": 0,
    "expected": 0,
    "percent": 0,
    "arrays": 0,
    "cancel": 0,
    "reading": 0,
    "compiled": 0,
    "compiled_beside": 0,
    "version": 0,
    "executors": 0,
    "geometry": 0,
    "optimize": 1,
    "cameras": 1,
    "targets": 1,
    "patterns": 1,
    "robots": 1,
    "data": 2,
    "opencv": 2,
    "formats": 3,
    "simulate": 3,
    "detection": 4,
    "calibrate": 5,
    "perceive": 6,
    "devices": 6,
    "diagnose": 6,
    "servoing": 7,
    "verification": 7,
    "reports": 7,
    "studies": 8,
    "tasks": 9,
    "cli": 10,
    "app": 10,
    "ros": 10,
}
NUMERIC_FLOORS = 2
NUMERIC_LIBRARIES = {"numpy", "scipy", "numba"}
BELOW_TASKS = {skin: {"calibrate", "detection", "formats", "optimize"} for skin in ("cli", "app", "ros")}
"""What a skin may not import at all: a task does the work."""
HOME = {
    "mujoco": {"simulate"},
    "mink": {"simulate"},
    "nicegui": {"app"},
    "distributed": {"executors"},
    "rospy": {"ros"},
    "rosgraph": {"ros"},
    "rclpy": {"ros"},
    "sensor_msgs": {"ros"},
    "geometry_msgs": {"ros"},
    "tf2_msgs": {"ros"},
    "cv2": {"opencv"},
    "yaml": {"targets", "formats"},
    "rosbags": {"formats"},
    "mcap": {"formats"},
    "apsw": {"formats"},
    "pupil_apriltags": {"targets"},
    "rtde_control": {"devices"},
    "rtde_receive": {"devices"},
    "panda_py": {"devices"},
    "pyrealsense2": {"devices"},
}
"""Heavy libraries and the only packages that may import them."""

ROOT_NAMES: set[str] = set()
"""What a package may import from `calibrant` itself, whose other names are the public API of all floors."""

UPWARD = {("data/results.py", "calibrant.reports.speech")}
"""The one import that runs up, inside a method: a result prints itself."""

LAZY = ("numba", "cv2", "scipy.optimize", "matplotlib", "mujoco", "rich", "jinja2", "pydantic")

FILES = sorted(PACKAGE.rglob("*.py"))


def package_of(file: Path) -> str:
    """The part of the house a file belongs to: its folder or, at the root, its own name."""
    return (
        file.relative_to(PACKAGE)
        .with_suffix(
            "",
        )
        .parts[0]
    )


def absolute(node: ast.ImportFrom, file: Path) -> str:
    """Module that `from … import` names, relative imports resolved."""
    if node.level == 0:
        return node.module or ""
    parents = ("calibrant", *file.relative_to(PACKAGE).parent.parts)
    base = parents[: len(parents) - (node.level - 1)]
    return ".".join([*base, *([node.module] if node.module else [])])


def imports(tree: ast.AST, file: Path) -> Iterator[tuple[int, str]]:
    """(line, full dotted name) of every import in a file, inside functions and TYPE_CHECKING blocks too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = absolute(node, file)
            yield from ((node.lineno, f"{module}.{alias.name}") for alias in node.names)
        elif isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if name in ("import_module", "__import__") and isinstance(node.args[0].value, str):
                yield node.lineno, node.args[0].value


def violations(tree: ast.AST, file: Path) -> list[str]:
    """What a file imports against the rules, one sentence each."""
    here = package_of(file)
    if here in ("__init__", "__main__"):
        return []
    if here not in FLOOR:
        return [f"{here} has no floor; give it one in DESIGN.md and here"]
    found = []
    for line, name in imports(tree, file):
        top, _, rest = name.partition(
            ".",
        )
        where = f"{file.relative_to(PACKAGE)}:{line} imports {name}"
        if top == "calibrant":
            if (file.relative_to(PACKAGE).as_posix(), name) in UPWARD:
                continue
            other = rest.split(
                ".",
            )[0]
            if other not in FLOOR and other not in ROOT_NAMES:
                found.append(f"{where}: import it from the package that defines it")
            elif other in BELOW_TASKS.get(here, ()):
                found.append(f"{where}: {here} asks a task for it")
            elif other in FLOOR and other != here and FLOOR[other] >= FLOOR[here] and not both_ground(here, other):
                found.append(f"{where}: {other} is on floor {FLOOR[other]}, {here} on floor {FLOOR[here]}")
        elif here in HOME.get(top, ()):
            continue
        elif FLOOR[here] <= NUMERIC_FLOORS and top not in sys.stdlib_module_names | NUMERIC_LIBRARIES:
            found.append(f"{where}: floors 0 to {NUMERIC_FLOORS} use NumPy, SciPy, Numba and the standard library only")
        elif top in HOME:
            found.append(f"{where}: {top} belongs in {', '.join(sorted(HOME[top]))}")
    return found


def both_ground(here: str, other: str) -> bool:
    """All may use errors and arrays, which use none, and cancel, which uses errors."""
    ground = ("errors", "arrays")
    return here not in ground and (other in ground or (other == "cancel" and here != "cancel"))


@pytest.mark.parametrize("file", FILES, ids=lambda f: str(f.relative_to(PACKAGE)))
def test_imports_go_down(file: Path) -> None:
    assert violations(parsed(file), file) == []


@pytest.mark.parametrize(
    ("file", "source"),
    [
        ("geometry/x.py", "from calibrant.cameras import Camera"),
        ("geometry/x.py", "def f():\n    from calibrant import cameras"),
        ("cameras/x.py", "import calibrant.targets.target"),
        ("cameras/x.py", "def f():\n    import cv2"),
        ("data/x.py", "if True:\n    import yaml"),
        ("data/x.py", "from ..detection import pipeline"),
        ("detection/x.py", "from calibrant import calibrate_intrinsics"),
        ("calibrate/x.py", "import importlib\nimportlib.import_module('calibrant.reports.html')"),
        ("reports/x.py", "import mujoco"),
        ("detection/x.py", "import cv2"),
        ("data/x.py", "from calibrant.opencv import cv2"),
        ("errors.py", "from calibrant.geometry import so3"),
        ("data/poses.py", "import_module('calibrant.reports.speech')"),
        ("errors.py", "from calibrant.cancel import checkpoint"),
        ("cli/x.py", "def f():\n    from calibrant.detection import detect"),
        ("app/x.py", "from calibrant.formats.cameras.read import read_camera"),
        ("helpers/x.py", "import os"),
    ],
)
def test_a_wrong_import_is_seen(file: str, source: str) -> None:
    assert len(violations(ast.parse(source), PACKAGE / file)) == 1


@pytest.mark.parametrize(
    ("file", "source"),
    [
        ("geometry/x.py", "import json\nfrom scipy import linalg\nfrom calibrant.errors import InputError"),
        ("data/results.py", "def f():\n    import_module('calibrant.reports.speech')"),
        ("data/x.py", "from calibrant.version import __version__\nfrom . import observations"),
        ("detection/x.py", "from calibrant.opencv import cv2\nfrom calibrant.targets import Target"),
        ("simulate/x.py", "def f():\n    import mujoco"),
        ("cli/x.py", "from calibrant.reports import terminal"),
    ],
)
def test_a_right_import_passes(file: str, source: str) -> None:
    assert violations(ast.parse(source), PACKAGE / file) == []


@pytest.mark.parametrize("module", ["calibrant", "calibrant.geometry.frames", "calibrant.data", "calibrant.cameras"])
def test_importing_loads_nothing_heavy(module: str) -> None:
    script = f"import sys, {module}; print(*[m for m in {LAZY!r} if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.split() == []
