"""What to call files: by their names, with as many folders before them as it takes to tell them apart."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path


def distinct_names(files: Sequence[Path]) -> dict[Path, str]:
    """The file's name for each; with as many folders before it as it takes to tell files of one name apart."""
    names = {file: file.name for file in files}
    depth = 1
    while len(set(names.values())) < len(files) and depth < max(len(f.parts) for f in files):
        depth += 1
        repeated = {name for name, times in Counter(names.values()).items() if times > 1}
        names = {f: "/".join(f.parts[-depth:]) if name in repeated else name for f, name in names.items()}
    return names
