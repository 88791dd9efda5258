"""Every module can be the first that a program imports: a circle shows only to who enters it at the wrong end."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest
from docs.house import parsed

import calibrant

PACKAGE = Path(calibrant.__file__).parent
Sources = dict[str, ast.Module]


def sources() -> Sources:
    """Module name and parsed source of every file."""
    found = {}
    for file in sorted(PACKAGE.rglob("*.py")):
        name = ".".join(file.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__")
        found[name] = parsed(file)
    return found


def at_load(node: ast.AST) -> Iterator[ast.Import | ast.ImportFrom]:
    """Imports that run when the module loads: not those of functions, nor those for the type checker."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import | ast.ImportFrom):
            yield child
        elif isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING":
            yield from (found for other in child.orelse for found in at_load(other))
        elif not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            yield from at_load(child)


def loads(name: str, tree: ast.Module, known: Sources) -> set[str]:
    """The modules that must have run before a module has: those it names, and the packages around them."""
    named: set[str] = set()
    for node in at_load(tree):
        if isinstance(node, ast.Import):
            named.update(alias.name for alias in node.names)
        elif node.module is not None:
            named.update({node.module, *(f"{node.module}.{alias.name}" for alias in node.names)})
    around = {".".join(other.split(".")[:end]) for other in named for end in range(1, other.count(".") + 2)}
    own = {".".join(name.split(".")[:end]) for end in range(1, name.count(".") + 2)}
    return {other for other in around - own if other in known}


def circle(known: Sources) -> list[str]:
    """One circle of modules that load each other; empty where there is none."""
    try:
        list(TopologicalSorter({name: loads(name, tree, known) for name, tree in known.items()}).static_order())
    except CycleError as error:
        return list(error.args[1])
    return []


@pytest.mark.long
def test_no_module_loads_itself_by_way_of_others() -> None:
    assert circle(sources()) == []


@pytest.mark.parametrize(
    ("files", "length"),
    [
        ({"calibrant.a": "import calibrant.b", "calibrant.b": "from calibrant import a"}, 3),
        ({"calibrant.a": "from calibrant.c.d import x", "calibrant.c": "import calibrant.a", "calibrant.c.d": ""}, 3),
        ({"calibrant.a": "import calibrant.b", "calibrant.b": "def f():\n    import calibrant.a"}, 0),
        (
            {
                "calibrant.c": "from calibrant.c.d import x",
                "calibrant.c.d": "import calibrant.c.e",
                "calibrant.c.e": "",
            },
            0,
        ),
    ],
    ids=["two modules", "by the package around", "in a function", "a package and its own"],
)
def test_a_circle_is_seen(files: dict[str, str], length: int) -> None:
    assert len(circle({name: ast.parse(text) for name, text in files.items()})) == length
