"""The part of YAML that target files use: block and flow mappings and lists, plain and quoted words, comments.

A YAML library does not belong on this floor. Anchors, tags, multi-line strings and several documents are not read, and
said so.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from calibrant.errors import InputError

Lines = list[tuple[int, int, str]]
"""(line number, indent, text without comment)."""

_COMMENT = re.compile(r"(^|\s)#.*$")
_KEY = re.compile(r"(?P<key>[A-Za-z_][\w-]*|\"[^\"]*\"|'[^']*')\s*:(?:\s+(?P<value>.*))?$")
_TOKEN = re.compile(r"\"[^\"]*\"|'[^']*'|[\[\]{},]|:(?=\s|$)|(?:[^\[\]{},:\"']|:(?!\s|$))+")


def read_yaml(path: Path) -> Any:
    """What a file holds. Raises: InputError naming the file, and the line that cannot be read."""
    try:
        return parse_yaml(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"target file {path} does not exist") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"target file {path} cannot be read as text: {error}") from None
    except InputError as error:
        raise InputError(f"target file {path}: {error}") from None


def parse_yaml(text: str) -> Any:
    """Mappings, lists and scalars of a YAML text. Raises: InputError naming the line that cannot be read."""
    lines: Lines = []
    for number, raw in enumerate(text.splitlines(), start=1):
        line = _COMMENT.sub("", raw).rstrip()
        if not line.strip() or line.strip() == "---":
            continue
        if "\t" in line[: len(line) - len(line.lstrip())]:
            raise InputError(f"line {number}: indent with spaces, not tabs")
        lines.append((number, len(line) - len(line.lstrip()), line.strip()))
    if not lines:
        return None
    value, rest = _block(lines, lines[0][1])
    if rest:
        raise InputError(f"line {rest[0][0]}: {rest[0][2]!r} does not fit the indentation above it")
    return value


def _block(lines: Lines, indent: int) -> tuple[Any, Lines]:
    is_list = lines[0][2] == "-" or lines[0][2].startswith("- ")
    items: list[Any] = []
    mapping: dict[str, Any] = {}
    while lines and lines[0][1] == indent:
        number, _, text = lines[0]
        if is_list:
            if not (text == "-" or text.startswith("- ")):
                break
            inner = text[1:].strip()
            if inner and (_KEY.match(inner) or inner.startswith("- ")):
                # What follows the dash is a block of its own, indented by the dash and its blanks.
                lines = [(number, indent + len(text) - len(inner), inner), *lines[1:]]
                value, lines = _block(lines, lines[0][1])
            else:
                value, lines = _value(inner, number, lines[1:], indent)
            items.append(value)
            continue
        match = _KEY.match(text)
        if match is None:
            raise InputError(f"line {number}: expected `key: value`, found {text!r}")
        value, lines = _value((match["value"] or "").strip(), number, lines[1:], indent)
        mapping[match["key"].strip("\"'")] = value
    return (items if is_list else mapping), lines


def _value(text: str, number: int, rest: Lines, indent: int) -> tuple[Any, Lines]:
    if not text:
        if rest and (rest[0][1] > indent or (rest[0][1] == indent and rest[0][2].startswith("- "))):
            return _block(rest, rest[0][1])
        return None, rest
    if text[0] not in "[{":
        return _scalar(text), rest
    # A flow value may go on over several lines until its brackets close.
    while text.count("[") + text.count("{") > text.count("]") + text.count("}") and rest:
        text, rest = f"{text} {rest[0][2]}", rest[1:]
    tokens = [t.strip() for t in _TOKEN.findall(text)]
    try:
        return json.loads("".join(t if t in "[]{},:" else json.dumps(_scalar(t)) for t in tokens if t)), rest
    except json.JSONDecodeError:
        raise InputError(f"line {number}: cannot read {text!r}") from None


def _scalar(text: str) -> Any:
    if text[0] in "\"'" and text[-1] == text[0] and len(text) > 1:
        return text[1:-1]
    if text[0] in "&*!|>":
        raise InputError(
            f"cannot read {text!r}: only plain words, numbers, lists and mappings are read from target files"
        )
    known = {"null": None, "~": None, "true": True, "false": False}
    if text.lower() in known:
        return known[text.lower()]
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
