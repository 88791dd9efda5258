"""The kinds of targets by name, and specs: chessboard:9x6:25mm. Adding a kind is its file and a line here."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

from calibrant.errors import InputError
from calibrant.targets import aprilgrid, bundle, charuco, circles, marker, point_folder
from calibrant.targets.grid import parse_grid
from calibrant.targets.lengths import parse_length
from calibrant.targets.target import Target
from calibrant.targets.yaml_file import read_yaml


@dataclass(frozen=True)
class TargetKind:
    """syntax: the spec's form with an example, for messages; parse: target of the fields after the kind's name."""

    syntax: str
    parse: Callable[[Sequence[str]], Target]


_CHESSBOARD = (
    "chessboard:COLUMNSxROWS:SQUARE in inner corners, such as chessboard:9x6:25mm, or chessboard:9x6:25mm:24.5mm for a "
    "print whose squares are 25 mm wide and 24.5 mm high"
)


def _chessboard(fields: Sequence[str]) -> Target:
    from calibrant.targets.chessboard import Chessboard

    if len(fields) not in (2, 3):
        raise InputError(f"a chessboard spec needs a size and a length: {_CHESSBOARD}")
    columns, rows = parse_grid(fields[0], what="a chessboard's size in inner corners")
    lengths = [parse_length(field, what="the square's side") for field in fields[1:]]
    return Chessboard(columns, rows, *lengths)


KINDS: dict[str, TargetKind] = {
    "chessboard": TargetKind(_CHESSBOARD, _chessboard),
    "charuco": TargetKind(charuco.SYNTAX, charuco.parse),
    "circles": TargetKind(circles.SYNTAX, circles.parse),
    "aprilgrid": TargetKind(aprilgrid.SYNTAX, aprilgrid.parse),
    "marker": TargetKind(marker.SYNTAX, marker.parse),
    "bundle": TargetKind(bundle.SYNTAX, bundle.parse),
    "points": TargetKind(point_folder.SYNTAX, point_folder.parse),
}


_BUNDLES = {"markers", "cubes"}
"""Keys that tell a bundle's own file, where it has no line `target: bundle`."""


def parse_target(spec: str) -> Target:
    """The target of a spec, or of a YAML file with a line `target: SPEC`, or of a bundle's own file.

    Args: spec, such as charuco:5x7:40mm:20mm:DICT_6X6_250 or board.yaml.
    Raises: InputError naming what is wrong and the expected form.

        >>> import calibrant as cb
        >>> len(cb.parse_target("chessboard:9x6:25mm").points)
        54
    """
    if not isinstance(spec, str):
        raise InputError(f"a target's spec is text, such as chessboard:9x6:25mm, or a file's name; got {spec!r}")
    text = spec.strip()
    if text.lower().endswith((".yaml", ".yml")) and ":" not in text.removeprefix(Path(text).drive):
        return _parse_spec(_spec_in_yaml(Path(text)), where=f"{text}: ")
    return _parse_spec(text, where="")


def _parse_spec(text: str, *, where: str) -> Target:
    kind, *fields = text.split(":")
    entry = KINDS.get(kind.strip().lower())
    if entry is None:
        raise InputError(f"{where}unknown kind of target {kind!r} in {text!r}; {_kinds_like(kind)}")
    try:
        return entry.parse(fields)
    except InputError as error:
        raise InputError(f"{where}target {text!r}: {error}") from None


def _spec_in_yaml(path: Path) -> str:
    content = read_yaml(path)
    keys = content if isinstance(content, dict) else {}
    spec = keys.get("target")
    # A bundle's own file is its spec.
    if str(spec).strip().lower() == "bundle" or (spec is None and _BUNDLES & set(keys)):
        return f"bundle:{path}"
    if not isinstance(spec, str) or not spec:
        raise InputError(
            f"target file {path} has no line `target: SPEC`, such as target: chessboard:9x6:25mm, and is no bundle, "
            "which has `dictionary: NAME` and a list `markers:` or `cubes:`"
        )
    return spec


def _kinds_like(kind: str) -> str:
    """The form of the kind whose name is nearest, or the names of all."""
    name = kind.strip().lower()
    near = [k for k in KINDS if name and k.startswith(name)] or get_close_matches(name, KINDS, n=1)
    if near:
        return f"did you mean {KINDS[near[0]].syntax}?"
    return f"known kinds: {', '.join(KINDS)}; or a YAML file. A spec is such as chessboard:9x6:25mm"
