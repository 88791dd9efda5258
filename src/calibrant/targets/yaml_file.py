"""YAML with bounds: files that people write by hand, and those that programs print. PyYAML, once its events are looked
through.

An alias repeats what its anchor names: ten lines of them unfold into more than a computer holds, and one that names
what it stands in has no end. So what a document unfolds to is counted before anything is built, as is how deep its
lists lie in each other; numbers may have any length, and a key stands once.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibrant.errors import InputError
from calibrant.reading.files import DOCUMENT, read_text
from calibrant.reading.json_text import DEEPEST, TOO_DEEP

if TYPE_CHECKING:
    import yaml

MOST_VALUES = 300_000
"""Values a document unfolds to: more than fit into the largest file without aliases."""
_INTEGER_DIGITS = 18

Constructor = Callable[[Any, Any], Any]


def read_yaml(path: Path, *, what: str = "target file") -> Any:
    """What a file holds. Raises: InputError naming the file, and the line that cannot be read."""
    text = read_text(path, most=DOCUMENT, what=what, expected="YAML")
    try:
        return parse_yaml(text)
    except InputError as error:
        raise InputError(f"{what} {path}: {error}") from None


def parse_yaml(text: str) -> Any:
    """Mappings, lists and scalars of a YAML text. Raises: InputError naming the line that cannot be read."""
    documents = parse_documents(text)
    if len(documents) > 1:
        raise InputError(f"it holds {len(documents)} documents (separated by ---); expected one")
    return documents[0] if documents else None


def parse_documents(text: str, constructors: Mapping[str, Constructor] | None = None) -> list[Any]:
    """Every document of a YAML text that holds something.

    Args: constructors: of tags beyond YAML's own. Raises: InputError naming the line that cannot be read.
    """
    import yaml

    if len(text) > DOCUMENT.size:
        raise InputError(f"it has {len(text)} characters; expected {DOCUMENT.size} at most ({DOCUMENT.reason})")
    try:
        _check_events(text)
        loader = _loader(constructors or {})
        return [found for found in yaml.load_all(text, Loader=loader) if found is not None]
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        if "nesting depth" in str(error.problem):
            raise InputError(f"line {line}: {TOO_DEEP}") from None
        tabs = any("\t" in text_line for text_line in text.splitlines()[line - 1 : line])
        cure = "; indent with spaces, not tabs" if tabs else ""
        raise InputError(f"line {line}: {error.problem}{cure}") from None
    except (yaml.YAMLError, ValueError, TypeError, OverflowError) as error:
        raise InputError(" ".join(str(error).split())) from None
    except RecursionError:
        raise InputError(TOO_DEEP) from None


def _check_events(text: str) -> None:
    """Raises: InputError for lists too deep, aliases that turn round or unfold to too much."""
    import yaml

    starts = (yaml.SequenceStartEvent, yaml.MappingStartEvent)
    ends = (yaml.SequenceEndEvent, yaml.MappingEndEvent)
    known: dict[str, tuple[int, int]] = {}  # values and depth below each anchor
    open_: list[tuple[str | None, int, int]] = []  # anchor, values when it began, depth so far
    values = 0
    for event in yaml.parse(text, Loader=_base()):
        if isinstance(event, yaml.DocumentStartEvent):
            known = {}
        elif isinstance(event, starts):
            values += 1
            open_.append((event.anchor, values, 0))
            if len(open_) > DEEPEST:
                raise InputError(f"line {_line(event)}: {TOO_DEEP}")
        elif isinstance(event, ends):
            anchor, began, depth = open_.pop()
            if anchor is not None:
                known[anchor] = (values - began + 1, depth + 1)
            _deepen(open_, depth + 1)
        elif isinstance(event, yaml.AliasEvent):
            line = _line(event)
            if event.anchor not in known:
                turns = any(anchor == event.anchor for anchor, _, _ in open_)
                what = "stands within what it names" if turns else "names nothing above it"
                raise InputError(f"line {line}: the alias *{event.anchor} {what}")
            count, depth = known[event.anchor]
            values += count
            if len(open_) + depth > DEEPEST:
                raise InputError(f"line {line}: {TOO_DEEP}")
            _deepen(open_, depth)
        elif isinstance(event, yaml.ScalarEvent):
            values += 1
            if event.anchor is not None:
                known[event.anchor] = (1, 0)
        if values > MOST_VALUES:
            line = _line(event)
            raise InputError(f"line {line}: it holds, or its aliases unfold to, more than {MOST_VALUES} values")


def _line(event: yaml.Event) -> int:
    return event.start_mark.line + 1 if event.start_mark is not None else 1


def _deepen(open_: list[tuple[str | None, int, int]], depth: int) -> None:
    """Tell what is open that something of this depth stands in it."""
    if open_:
        anchor, began, so_far = open_[-1]
        open_[-1] = (anchor, began, max(so_far, depth))


def _base() -> type[yaml.SafeLoader]:
    """PyYAML's safe loader, the one in C where it is there."""
    import yaml

    base: type[yaml.SafeLoader] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    return base


def _loader(constructors: Mapping[str, Constructor]) -> Any:
    """The safe loader with 1e-3 and 010 numbers as in YAML 1.2, clocks texts, and every key once."""
    import yaml

    class Loader(_base()):  # type: ignore[misc]
        def construct_mapping(self, node: Any, deep: bool = False) -> Any:
            seen: set[tuple[str, str]] = set()
            for key, _ in node.value if isinstance(node, yaml.MappingNode) else ():
                if not isinstance(key, yaml.ScalarNode) or key.value == "<<":
                    continue
                if (key.tag, key.value) in seen and not key.tag.endswith(":merge"):
                    line = key.start_mark.line + 1
                    raise InputError(f"line {line}: the key {key.value[:40]!r} stands there twice; keep one")
                seen.add((key.tag, key.value))
            return super().construct_mapping(node, deep=deep)

    number = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$")
    Loader.add_implicit_resolver("tag:yaml.org,2002:float", number, list("-+.0123456789"))
    Loader.add_constructor("tag:yaml.org,2002:int", _integer)
    Loader.add_constructor("tag:yaml.org,2002:float", _float)
    for tag, constructor in constructors.items():
        Loader.add_constructor(tag, constructor)
    return Loader


def _integer(loader: Any, node: yaml.ScalarNode) -> Any:
    text = loader.construct_scalar(node).replace("_", "")
    if ":" in text:
        return text  # 12:30 is a time, not 750
    digits = text.lstrip("+-")
    if digits[:2].lower() in ("0x", "0b") and len(digits) <= _INTEGER_DIGITS:
        return int(text, 0)
    return int(text) if len(digits) <= _INTEGER_DIGITS else float(text)


def _float(loader: Any, node: yaml.ScalarNode) -> Any:
    text = str(loader.construct_scalar(node)).replace("_", "").lower()
    if ":" in text:
        return text
    words = {".inf": "inf", "+.inf": "inf", "-.inf": "-inf", ".nan": "nan"}
    return float(words.get(text, text))
