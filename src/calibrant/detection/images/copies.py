"""Files that are one picture, byte by byte: noise makes two photos differ, so that a copy is no second measurement."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from calibrant.errors import InputError
from calibrant.reading.files import open_file


def copies_of(files: Sequence[Path]) -> dict[Path, Path]:
    """The first of the files that is the same picture, for each that has one before it; frames of a video have none."""
    sizes = {f: f.stat().st_size for f in files if f.is_file()}
    alike = Counter(sizes.values())
    first: dict[bytes, Path] = {}
    copies = {}
    for file, size in sizes.items():
        if alike[size] < 2 or size == 0:
            continue
        try:
            with open_file(file) as stream:
                digest = hashlib.file_digest(stream, "sha256").digest()
        except InputError:  # who reads its picture says why it cannot be read
            continue
        original = first.setdefault(digest, file)
        if original != file:
            copies[file] = original
    return copies


def copies_note(copies: Mapping[Path, Path], names: Mapping[Path, str]) -> str:
    """A whole sentence naming every copy."""
    listed = ", ".join(f"{names[copy]} (of {names[original]})" for copy, original in copies.items())
    head = "1 picture is a copy" if len(copies) == 1 else f"{len(copies)} pictures are copies"
    return f"{head} of another, byte by byte, which counts once: {listed}."
