"""A file or folder that another program wrote, opened once and looked at by every format that might know it.

    document = Document(Path("camchain.yaml"))
    document.data["cam0"]["intrinsics"]     # JSON, YAML, TOML or OpenCV's FileStorage, parsed within bounds
    document.root.tag                       # any other XML
    document.text, document.head, document.names

What cannot be parsed is None, and `trouble` says why: for another format it may be plain text.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from calibrant.errors import InputError
from calibrant.formats.documents.opencv_storage import check_depth, read_json, read_xml, read_yaml_documents
from calibrant.reading.files import DOCUMENT, Most, decoded, foreign, open_file, read_bytes, reason_of

CONTENT = Most(512_000_000, "a reconstruction of ten thousand pictures")
_HEAD = 4096
"""Bytes from which a kind of file is known."""
_MOST_NAMES = 100_000
_YAML_SUFFIXES = (".yaml", ".yml")
_STORAGE_ROOT = "opencv_storage"


@dataclass(frozen=True)
class Document:
    """A path and what is in it; each part is read when a format first asks for it.

    Raises (all properties): InputError where the file cannot be read, or is larger than any of its kind.
    """

    path: Path

    @cached_property
    def is_folder(self) -> bool:
        """Whether it is a folder."""
        return self.path.is_dir()

    @cached_property
    def names(self) -> frozenset[str]:
        """Names of what lies in the folder; empty for a file."""
        if not self.is_folder:
            return frozenset()
        try:
            found = [entry.name for _, entry in zip(range(_MOST_NAMES + 1), self.path.iterdir())]
        except OSError as error:
            raise InputError(f"folder {self.path} cannot be read: {reason_of(error)}") from None
        if len(found) > _MOST_NAMES:
            raise InputError(f"folder {self.path} holds more than {_MOST_NAMES:,} files; give the one that is meant")
        return frozenset(found)

    @cached_property
    def head(self) -> bytes:
        """The file's first bytes, enough to know what it is; none of a folder."""
        if self.is_folder:
            return b""
        with open_file(self.path, most=CONTENT) as stream:
            return stream.read(_HEAD)

    @cached_property
    def content(self) -> bytes:
        """All bytes of the file; none of a folder."""
        return b"" if self.is_folder else read_bytes(self.path, most=CONTENT)

    @cached_property
    def foreign(self) -> str | None:
        """What the file is where it belongs to a program of another kind (a ROS bag, a MATLAB file, an archive)."""
        return foreign(self.head, self.path)

    @cached_property
    def text(self) -> str | None:
        """The file as text; None where it is none."""
        if self.is_folder or self.foreign is not None or b"\0" in self.head.removeprefix(b"\xff\xfe")[:2]:
            return None
        try:
            return decoded(self.content, self.path)
        except InputError:
            return None

    @cached_property
    def data(self) -> Any:
        """A mapping or a list from JSON, YAML, TOML or FileStorage XML; None where it is none of these."""
        found = self._parsed[0]
        return found if isinstance(found, Mapping | list) else None

    @cached_property
    def mapping(self) -> Mapping[str, Any]:
        """`data` where it is a mapping, else an empty one, so that a format may look for its keys."""
        return self.data if isinstance(self.data, Mapping) else {}

    @cached_property
    def root(self) -> ElementTree.Element | None:
        """The root of XML that is not OpenCV's FileStorage; None where it is none."""
        return self._xml[0]

    @property
    def trouble(self) -> str | None:
        """Why text that looks like JSON, YAML, TOML or XML could not be parsed; None where it could."""
        return self._parsed[1] or self._xml[1]

    @cached_property
    def _start(self) -> str:
        return "" if self.text is None else self.text[:_HEAD].lstrip()

    @cached_property
    def _parsed(self) -> tuple[Any, str | None]:
        text = self.text
        if text is None:
            return None, None
        try:
            if self._start.startswith("<"):
                return (read_xml(text, str(self.path)) if _STORAGE_ROOT in self._start else None), None
            if self.path.suffix.lower() == ".toml":
                return tomllib.loads(text), None
            if self._start.startswith(("{", "[")):
                return self._flow(text), None
            return self._yaml(text), None
        except tomllib.TOMLDecodeError as error:
            return None, f"{self.path}: not TOML ({error})"
        except InputError as error:
            return None, str(error)

    def _flow(self, text: str) -> Any:
        """JSON, or YAML in flow style, which begins so too; where it is neither, the message is JSON's."""
        try:
            return read_json(text, str(self.path))
        except InputError as error:
            if self.path.suffix.lower() in _YAML_SUFFIXES and isinstance(error.__cause__, json.JSONDecodeError):
                with suppress(InputError):
                    return self._yaml(text)
            raise

    def _yaml(self, text: str) -> Any:
        """The one document. Text of another name is taken for YAML only where it is short: YAML is slow."""
        if self.path.suffix.lower() not in _YAML_SUFFIXES and len(text) > DOCUMENT.size:
            return None
        if len(text) > DOCUMENT.size:
            raise InputError(f"{self.path} has {len(text) / 1e6:,.0f} MB; {DOCUMENT.words} at most: {DOCUMENT.reason}")
        documents = read_yaml_documents(text, str(self.path))
        told = [{k: v for k, v in d.items() if k != "header"} if isinstance(d, Mapping) else d for d in documents]
        if any(repr(other) != repr(told[0]) for other in told[1:]):
            raise InputError(f"{self.path}: {len(documents)} documents that differ, separated by ---; expected one")
        return documents[0] if documents else None

    @cached_property
    def _xml(self) -> tuple[ElementTree.Element | None, str | None]:
        text = self.text
        if text is None or not self._start.startswith("<") or _STORAGE_ROOT in self._start:
            return None, None
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            return None, f"{self.path}: document types and entities are not read; remove them"
        try:
            root = ElementTree.fromstring(text.strip())
            check_depth(root, str(self.path))
        except ElementTree.ParseError as error:
            return None, f"{self.path}:{error.position[0]}: not XML ({error})"
        except InputError as error:
            return None, str(error)
        return root, None
