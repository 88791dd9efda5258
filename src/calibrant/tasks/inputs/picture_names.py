"""Names of the pictures that show what was found: the photo's own, with a word that keeps it apart from the photo."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import PurePath

_PHOTOS = (".png", ".jpg", ".jpeg", ".jpe", ".tif", ".tiff", ".bmp", ".dib", ".webp", ".jp2", ".pgm", ".ppm", ".pbm")


def picture_names(ids: Iterable[str]) -> dict[str, str]:
    """The file of each view: 00-seen.png of 00.jpg. Folders in a view's name, which tell photos of one name apart,
    become part of it, as does the ending where two photos differ by nothing else."""
    every = list(ids)
    short = {name: _without_ending(name).replace("/", "_") for name in every}
    shared = Counter(short.values())
    return {
        name: f"{short[name] if shared[short[name]] == 1 else name.replace('/', '_').replace('.', '_')}-seen.png"
        for name in every
    }


def _without_ending(name: str) -> str:
    return name[: -len(PurePath(name).suffix)] if PurePath(name).suffix.lower() in _PHOTOS else name
