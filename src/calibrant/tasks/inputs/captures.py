"""Captures of pattern sequences: a folder each, its pictures in the order of the patterns."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import InputError

if TYPE_CHECKING:
    from calibrant.detection.structured_light.capture import Capture, Grey
    from calibrant.patterns.sequence import PatternSequence


def capture_folders(given: Sequence[str]) -> list[Path]:
    """The folders of captures: those named, those a pattern matches, or those within one that holds folders alone.

    Raises: InputError for what is no folder, or holds neither pictures nor folders of them.
    """
    from glob import glob, has_magic

    out: list[Path] = []
    for text in given:
        paths = sorted(map(Path, glob(text)), key=_natural) if has_magic(text) else [Path(text).expanduser()]
        folders = [p for p in paths if p.is_dir()]
        if not folders:
            raise InputError(f"{text}: no folder of that name; --captures takes a folder for each pose of the board")
        for folder in folders:
            out += [folder] if _pictures_in(folder) else _within(folder)
    return list(dict.fromkeys(out))


def _within(folder: Path) -> list[Path]:
    inside = sorted((p for p in folder.iterdir() if p.is_dir() and _pictures_in(p)), key=_natural)
    if not inside:
        raise InputError(f"the folder {folder} holds no pictures; expected those of a capture, or a folder for each")
    return inside


def _pictures_in(folder: Path) -> bool:
    from calibrant.detection.images.files import EXTENSIONS

    return any(p.suffix.lower() in EXTENSIONS for p in folder.iterdir())


def _natural(path: Path) -> list[tuple[int, int, str]]:
    from calibrant.detection.images.files import natural_key

    return natural_key(path)


def files_of(folder: Path) -> list[Path]:
    """The pictures of a capture, numbers by value."""
    from calibrant.detection.images.files import expand

    return expand([folder])


def read_captured(name: str, folder: Path, sequence: PatternSequence, *, mirror_x: bool = False) -> Capture:
    """A capture, called so: its pictures are those of the sequence, in its order.

    Raises: InputError naming what is missing, doubled or out of place.
    """
    from calibrant.detection.images.images import load_grey
    from calibrant.detection.structured_light.capture import Capture, read_pictures
    from calibrant.detection.structured_light.order import check_count, check_order

    def grey_of(file: str) -> Grey:
        grey = load_grey(file)
        return grey[:, ::-1].copy() if mirror_x else grey

    files = [str(f) for f in files_of(folder)]
    names = [Path(f).name for f in files]
    pictures = read_pictures(files, grey_of)
    check_count(name, names, sequence, pictures)
    return check_order(Capture(name, sequence, pictures, tuple(files)))
