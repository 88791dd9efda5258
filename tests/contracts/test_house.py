"""The plan of the house: no circles, no storerooms, no long files, and a picture that is what the imports say."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest
from docs import house

GRAPH = house.downward(house.modules())

MOST_FILES = 20
MOST_LINES = 400
MOST_OF_A_FUNCTION = 60

LONG: Mapping[str, str] = {}
"""Functions that are longer, and why."""


def sources() -> Iterator[tuple[str, str]]:
    """Path from src/calibrant, and text, of every file."""
    for file in sorted(house.PACKAGE.rglob("*.py")):
        yield file.relative_to(house.PACKAGE).as_posix(), file.read_text(encoding="utf-8")


def test_no_module_needs_one_that_needs_it() -> None:
    """But for what a result promises: it writes and prints itself (`house.UPWARD`)."""
    assert house.circles(GRAPH) == []


def test_no_room_needs_one_that_needs_it() -> None:
    assert house.circles(house.rooms(GRAPH)) == []


def test_the_promises_of_a_result_are_imports_inside_a_function() -> None:
    """What leads upward must not be loaded with the result itself."""
    tree = house.parsed(house.PACKAGE / "data" / "results.py")
    at_the_top = [n for n in tree.body if isinstance(n, ast.Import | ast.ImportFrom)]
    named = set(house.named_imports(ast.Module(at_the_top, []), "calibrant.data"))
    assert not {name for name in named if "result_file" in name or "reports" in name}


@pytest.mark.parametrize("base", ["src/calibrant", "tests", "benchmarks", "docs"])
def test_no_folder_is_a_storeroom(base: str) -> None:
    folders = [f for f in (house.ROOT / base).rglob("*") if f.is_dir()] + [house.ROOT / base]
    full = {
        folder.relative_to(house.ROOT).as_posix(): n
        for folder in folders
        if (n := len([f for f in folder.glob("*.py") if f.name != "__init__.py"])) > MOST_FILES
    }
    assert full == {}, f"more than {MOST_FILES} loose files: make rooms"


def test_no_file_is_long() -> None:
    assert {name: n for name, text in sources() if (n := text.count("\n")) > MOST_LINES} == {}


def test_no_function_is_long() -> None:
    found = {}
    for file in sorted(house.PACKAGE.rglob("*.py")):
        name = file.relative_to(house.PACKAGE).as_posix()
        for node in ast.walk(house.parsed(file)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = (node.end_lineno or node.lineno) - node.lineno + 1
                if lines > MOST_OF_A_FUNCTION:
                    found[f"{name}:{node.name}"] = lines
    assert {name: lines for name, lines in found.items() if name not in LONG} == {}
    assert set(LONG) <= set(found), "shorter now: leave the list"


def test_the_picture_is_what_the_imports_say() -> None:
    text = house.PAGE.read_text(encoding="utf-8")
    assert house.page(text) == text, "run python docs/house.py"


def test_every_room_says_what_it_is_for() -> None:
    assert [room for room in house.rooms(GRAPH) if room != "calibrant" and not house.purpose(room)] == []


GRAPHS = {
    "a chain": ({"a": {"b"}, "b": {"c"}, "c": set()}, []),
    "a circle of three": ({"a": {"b"}, "b": {"c"}, "c": {"a"}}, [{"a", "b", "c"}]),
    "two circles that touch": ({"a": {"b"}, "b": {"a", "c"}, "c": {"b"}}, [{"a", "b", "c"}]),
    "two apart": ({"a": {"b"}, "b": {"a", "c"}, "c": {"d"}, "d": {"c"}}, [{"c", "d"}, {"a", "b"}]),
}


@pytest.mark.parametrize("name", GRAPHS)
def test_circles_are_seen(name: str) -> None:
    edges, expected = GRAPHS[name]
    graph = {node: frozenset(used) for node, used in edges.items()}
    assert [set(c) for c in house.circles(graph)] == expected
    assert house.circles(house.joined(graph)) == []


def test_an_import_is_seen_wherever_it_stands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = {
        "__init__.py": "",
        "low/__init__.py": "from calibrant.low.one import f\n",
        "low/one.py": "def f():\n    from calibrant.high import two\n",
        "high/__init__.py": "",
        "high/two.py": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from calibrant.low import one\n",
        "high/three.py": "from ..low import one\nimport numpy\n",
        "high/four.py": "import importlib\nimportlib.import_module('calibrant.low.one')\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(house, "PACKAGE", tmp_path)
    found = house.modules()
    assert found["low.one"] == {"high", "high.two"}
    assert found["low"] == {"low.one"}
    assert found["high.two"] == set()
    assert found["high.three"] == found["high.four"] == {"low", "low.one"}


def test_what_a_longer_way_reaches_has_no_arrow_of_its_own() -> None:
    graph = {"a": frozenset({"b", "c"}), "b": frozenset({"c"}), "c": frozenset()}
    assert house.levels(graph) == {"a": 2, "b": 1, "c": 0}
    assert house.direct(graph) == {"a": frozenset({"b"}), "b": frozenset({"c"}), "c": frozenset()}
