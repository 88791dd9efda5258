"""Documents written all or none: each beside its place first, then all moved there. For those who call tasks."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable
from pathlib import Path

from calibrant.cancel import checkpoint, undisturbed
from calibrant.errors import InputError
from calibrant.reading.files import draft, open_file, reason_of
from calibrant.tasks.outcome import Document


def check_writable(path: Path, *, force: bool) -> None:
    """Raises: InputError when a file cannot be written there, or exists and `force` is False."""
    if path.is_dir():
        raise InputError(f"cannot write {path}: it is a folder; give a file name")
    if path.exists() and not force:
        raise InputError(f"{path} exists already; give another name, or --force to replace it")
    if not path.parent.is_dir():
        raise InputError(f"cannot write {path}: there is no folder {path.parent}; make it first")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"cannot write {path}: the folder {path.parent} is not writable")


def check_spared(paths: Iterable[Path], inputs: Iterable[str | Path]) -> None:
    """Raises: InputError naming the first path that is one of the files read: these are never written over."""
    read = {Path(file).resolve() for file in inputs}
    for path in paths:
        if path.resolve() in read:
            raise InputError(f"{path} is an input of this command and is left alone; give the output another name")


def check_folder(path: Path, *, option: str) -> None:
    """Raises: InputError when files cannot be written into this folder, which need not be there yet."""
    if path.exists() and not path.is_dir():
        raise InputError(f"{option} {path} is a file; give a folder")
    if not path.parent.is_dir():
        raise InputError(f"{option} {path}: there is no folder {path.parent}; make it first")
    place = path if path.is_dir() else path.parent
    if not os.access(place, os.W_OK):
        raise InputError(f"{option} {path}: the folder {place} is not writable")


def write_documents(documents: Iterable[Document], *, force: bool) -> list[Path]:
    """Write every document, or none; returns where they are. A folder that is not there is made for them.

    Raises: InputError for a file that exists (unless `force`) or cannot be written; and whatever making a document
    raises. Then every file is as it was before.
    """
    drafts: dict[Path, Path] = {}
    made: list[Path] = []
    try:
        for document in documents:
            checkpoint()
            _write_draft(document, drafts, made, force=force)
        with undisturbed() as disturbed:
            written = _moved(drafts)
    except BaseException:
        with undisturbed():
            for left in drafts.values():
                left.unlink(missing_ok=True)
            for folder in reversed(made):
                folder.rmdir()
        raise
    if disturbed:
        raise KeyboardInterrupt(f"interrupted; every file was written: {', '.join(map(str, written))}")
    return written


def _write_draft(document: Document, drafts: dict[Path, Path], made: list[Path], *, force: bool) -> None:
    path = document.path
    for folder in _missing_folders(document):
        try:
            folder.mkdir()
        except OSError as error:
            raise InputError(f"cannot make the folder {folder}: {error.strerror or error}") from None
        made.append(folder)
    check_writable(path, force=force)
    if path in drafts:
        raise InputError(f"two outputs would be written to {path}; give each a name of its own")
    content = document.bytes()
    target = Path(os.path.realpath(path))  # a link stays a link: the file behind it is replaced
    try:
        drafts[path], stream = draft(target)
        with stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None


def _missing_folders(document: Document) -> list[Path]:
    """Folders to make before it, outermost first; none where more is missing than may be made."""
    folder, missing = document.path.parent, list[Path]()
    while not folder.exists() and (not missing or (document.within and folder.is_relative_to(document.within))):
        missing.insert(0, folder)
        folder = folder.parent
    return missing if folder.is_dir() else []


def _moved(drafts: dict[Path, Path]) -> list[Path]:
    """Every draft moved to its place; what stood there comes back when one of them cannot be moved."""
    before: dict[Path, Path | None] = {}
    try:
        for path, draft in drafts.items():
            if len(drafts) > 1:
                before[path] = _second_name(path)
            draft.replace(os.path.realpath(path))
    except (OSError, InputError) as error:
        for place, old in before.items():
            if old is None:
                place.unlink(missing_ok=True)
            else:
                old.replace(os.path.realpath(place))
        raise InputError(f"cannot write {path}: {reason_of(error)}; nothing was written") from None
    for old in before.values():
        if old is not None:
            old.unlink(missing_ok=True)
    return list(drafts)


def _second_name(path: Path) -> Path | None:
    """The old file under a second name too, which nobody can foresee; None where there is none."""
    old = Path(os.path.realpath(path))
    if not old.exists():
        return None
    second, stream = draft(old)
    try:
        with stream, open_file(old) as before:
            shutil.copyfileobj(before, stream)
        shutil.copystat(old, second)
    except (OSError, InputError):
        second.unlink(missing_ok=True)
        raise
    return second
