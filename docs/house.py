"""Draws the picture of the house in docs/house.md from the imports of src/calibrant, so that it stays true.

    python docs/house.py            write docs/house.md again
    python docs/house.py --check    exit 1 where the page is not what the imports say

A room is a folder of src/calibrant, or a file that stands alone at its root. Room a stands on room b where a file of a
imports one of b, inside functions too. Rooms on a line need nothing of each other; each needs lines below it only.
"""

from __future__ import annotations

import ast
import gc
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "src" / "calibrant"
PAGE = ROOT / "docs" / "house.md"
FIRST = "<!-- drawn from the imports by docs/house.py -->"
LAST = "<!-- to here -->"
DRAWN = ("calibrate", "detection", "diagnose", "formats")
"""Packages whose rooms have a picture of their own."""
EVERYWHERE = frozenset({"errors", "arrays"})
"""What nearly every file imports: drawn, it would hide the rest."""

Graph = Mapping[str, frozenset[str]]
"""Who imports whom, by name."""


def module_name(file: Path) -> str:
    """Dotted name below `calibrant`, of a folder for its __init__.py; "" for the package itself."""
    parts = file.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def parsed(file: Path) -> ast.Module:
    """A file's tree, parsed once for all who look at the house."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    gc.freeze()  # a million nodes that stay: looking for garbage among them costs more than parsing them again
    return tree


def named_imports(tree: ast.AST, package: str) -> Iterator[str]:
    """Full dotted names that a file of this package imports, wherever the import stands.

    Imports under TYPE_CHECKING are left out: nothing happens there.
    """
    for node in _executed(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            yield from (f"{base}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if name in ("import_module", "__import__") and isinstance(node.args[0].value, str):
                yield node.args[0].value


def _executed(tree: ast.AST) -> Iterator[ast.AST]:
    """Nodes of a tree but for the bodies of `if TYPE_CHECKING:`."""
    yield tree
    if isinstance(tree, ast.If) and isinstance(tree.test, ast.Name) and tree.test.id == "TYPE_CHECKING":
        for node in tree.orelse:
            yield from _executed(node)
        return
    for child in ast.iter_child_nodes(tree):
        yield from _executed(child)


def modules() -> Graph:
    """Which module imports which, names below `calibrant`."""
    files = {module_name(f): f for f in sorted(PACKAGE.rglob("*.py"))}
    found = {}
    for name, file in files.items():
        package = f"calibrant.{name}" if file.name == "__init__.py" else f"calibrant.{name}".rpartition(".")[0]
        used: set[str] = set()
        for full in named_imports(parsed(file), package.rstrip(".")):
            target = _module_of(full, files)
            if target is not None:
                # Python runs the folders' __init__ before a module, but for those that the importing one lies in.
                above = {target.rsplit(".", n)[0] for n in range(1, target.count(".") + 1)}
                used |= {target} | {a for a in above if not f"{name}.".startswith(f"{a}.")}
        found[name] = frozenset(used - {name})
    return found


def _module_of(full: str, files: Mapping[str, Path]) -> str | None:
    """The module that a dotted name lies in, None where it is not ours."""
    top, _, rest = full.partition(".")
    if top != "calibrant":
        return None
    while rest and rest not in files:
        rest = rest.rpartition(".")[0]
    return rest


def circles(graph: Graph) -> list[frozenset[str]]:
    """Sets of more than one node that all reach each other (Tarjan, "Depth-first search", SIAM J. Comput. 1, 1972)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[frozenset[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in sorted(graph[node]):
            if other not in index:
                visit(other)
            if other in stack:
                low[node] = min(low[node], low[other])
        if low[node] == index[node]:
            group = stack[stack.index(node) :]
            del stack[stack.index(node) :]
            if len(group) > 1:
                found.append(frozenset(group))

    for node in sorted(graph):
        if node not in index:
            visit(node)
    return found


UPWARD = {"data.results": frozenset({"data.result_file", "reports.speech", "reports"})}
"""The promises of a result: it writes and it prints itself, by an import inside the method. Left out of the picture."""


def downward(graph: Graph) -> Graph:
    """The graph without what `UPWARD` promises."""
    return {name: used - UPWARD.get(name, frozenset()) for name, used in graph.items()}


def room_of(module: str) -> str:
    """The folder a module lies in, from src/calibrant, such as calibrate/cell; a file at the root is its own room."""
    folder = PACKAGE / Path(*module.split("."))
    if module and folder.is_dir():
        return module.replace(".", "/")
    parent = module.rpartition(".")[0]
    return parent.replace(".", "/") if parent else module or "calibrant"


def rooms(graph: Graph) -> Graph:
    """Which room stands on which. That a folder's __init__ is run on the way to a room inside is no use of it."""
    found: dict[str, set[str]] = {room_of(name): set() for name in graph}
    for name, used in graph.items():
        taken = {u for u in used if not any(other.startswith(f"{u}.") for other in used)}
        found[room_of(name)] |= {room_of(other) for other in taken} - {room_of(name)}
    return {name: frozenset(used) for name, used in found.items()}


def packages(graph: Graph) -> Graph:
    """Which folder or file at the root of the package stands on which."""
    found: dict[str, set[str]] = {}
    for name, used in graph.items():
        if name and name != "__main__":
            top = name.partition(".")[0]
            found.setdefault(top, set()).update({other.partition(".")[0] for other in used} - {top, ""})
    return {name: frozenset(used) for name, used in found.items()}


def levels(graph: Graph) -> dict[str, int]:
    """How many others lie under each at most. Raises: ValueError naming a circle, where there is no under."""
    if found := circles(graph):
        raise ValueError(f"a circle of imports: {', '.join(sorted(found[0]))}")
    known: dict[str, int] = {}

    def level(name: str) -> int:
        if name not in known:
            known[name] = max((level(other) + 1 for other in graph[name] if other in graph), default=0)
        return known[name]

    for name in graph:
        level(name)
    return known


def joined(graph: Graph) -> Graph:
    """The graph with every circle as one node, named by all that are in it."""
    name = {member: " + ".join(sorted(circle)) for circle in circles(graph) for member in circle}
    found: dict[str, set[str]] = {}
    for node, used in graph.items():
        new = name.get(node, node)
        found.setdefault(new, set()).update({name.get(other, other) for other in used} - {new})
    return {node: frozenset(used) for node, used in found.items()}


def direct(graph: Graph) -> Graph:
    """The arrows that no longer way replaces (the transitive reduction)."""
    reach: dict[str, set[str]] = {}
    for name in sorted(graph, key=levels(graph).__getitem__):
        reach[name] = set().union(*({other} | reach[other] for other in graph[name] if other in graph))
    return {
        name: frozenset(o for o in used if o in graph and not any(o in reach[p] for p in used if p in graph and p != o))
        for name, used in graph.items()
    }


def picture(graph: Graph) -> list[str]:
    """A Mermaid chart of a graph without circles, the lowest at the bottom."""
    lines = ["```mermaid", "flowchart TD"]
    graph = joined(graph)
    level = levels(graph)
    for name in sorted(graph, key=lambda n: (-level[n], n)):
        arrows = sorted(direct(graph)[name])
        lines += [f"    {_node(name)}[{name}]"] + [f"    {_node(name)} --> {_node(other)}" for other in arrows]
    return [*lines, "```"]


def _node(name: str) -> str:
    return "n_" + "".join(c if c.isalnum() else "_" for c in name)


def purpose(room: str) -> str:
    """First line of what a room says of itself, without its floor."""
    folder = PACKAGE / room
    file = folder / "__init__.py" if folder.is_dir() else folder.with_suffix(".py")
    text = ast.get_docstring(parsed(file)) or ""
    line = text.splitlines()[0].rstrip(".")
    floor, colon, rest = line.partition(": ")
    return rest[:1].upper() + rest[1:] if colon and floor.startswith("Floor ") else line


def table(graph: Graph) -> list[str]:
    """A line a room: what it is for, and the packages or neighbours it stands on."""
    lines = ["| room | what it is for | stands on |", "|---|---|---|"]
    for room in sorted(graph):
        if room in ("calibrant", "__main__"):
            continue
        home = room.partition("/")[0]
        under = {other if other.partition("/")[0] == home else other.partition("/")[0] for other in graph[room]}
        lines.append(f"| `{room}` | {purpose(room)} | {', '.join(sorted(under - EVERYWHERE)) or '–'} |")
    return lines


def inside(graph: Graph, package: str) -> Graph:
    """The rooms of one package and the arrows between them."""
    mine = {name for name in graph if name == package or name.startswith(f"{package}/")}
    return {name: graph[name] & mine for name in mine}


def drawn() -> str:
    """What stands between the page's marks."""
    graph = downward(modules())
    house = {name: used - EVERYWHERE for name, used in packages(graph).items() if name not in EVERYWHERE}
    lines = ["", "### The packages", "", "All use `errors` and `arrays`, which are not drawn.", "", *picture(house)]
    for package in DRAWN:
        lines += ["", f"### Inside `{package}`", "", *picture(inside(rooms(graph), package))]
    return "\n".join([*lines, "", "### Every room", "", *table(rooms(graph)), ""])


def page(text: str) -> str:
    """The page with its picture drawn anew."""
    before, _, rest = text.partition(FIRST)
    _, _, after = rest.partition(LAST)
    return f"{before}{FIRST}\n{drawn()}\n{LAST}{after}"


def main(arguments: Sequence[str]) -> int:
    old = PAGE.read_text(encoding="utf-8")
    new = page(old)
    if "--check" in arguments:
        if new != old:
            sys.stderr.write("docs/house.md is not what the imports say; run python docs/house.py\n")
        return int(new != old)
    PAGE.write_text(new, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
