"""A project on the disk: its folder, read and written whole or not at all.

    with writing(Path("cell")) as held:                  # nobody else writes meanwhile
        held.write(edited(held.project), command="calibrant project …")

Results lie beside the project's file, each under a name made of its content: a new one never replaces what the file on
the disk still names. They are written first, the file last, by a rename; who reads at any moment, or after a cut of
power, finds the project of before or of after.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from calibrant.data import CalibrationResult
from calibrant.data.result_file import read_result, result_text, write_text
from calibrant.errors import InputError
from calibrant.formats.projects.checks import check_project
from calibrant.formats.projects.frames import check_frames
from calibrant.formats.projects.lock import WAIT_S, locked
from calibrant.formats.projects.records import MOST_OF_JOURNAL, Entry, Kept, Project
from calibrant.formats.projects.text import parse_project, project_text
from calibrant.reading.files import DOCUMENT, open_file, read_text
from calibrant.version import __version__

PROJECT_FILE = "calibrant.yaml"
RESULTS = "results"
_OURS = re.compile(r"(seen|cell|given)-[0-9a-f]{16}\.json")
_DRAFT = re.compile(r"\.((calibrant\.yaml)|((seen|cell|given)-[0-9a-f]{16}\.json))\.[0-9a-f]{16}\.tmp")


def folder_of(path: str | Path) -> Path:
    """The folder of a project, which may be named by its file. Raises: InputError where there is no project."""
    given = Path(path).expanduser()
    folder = given.parent if given.name == PROJECT_FILE and not given.is_dir() else given
    if not folder.is_dir():
        raise InputError(f"there is no folder {folder}; make a project with calibrant project new {given}")
    if not (folder / PROJECT_FILE).exists():
        raise InputError(
            f"there is no project in {folder.resolve()} (no {PROJECT_FILE}); name its folder with --project, or make "
            "one with calibrant project new"
        )
    return folder


def read_project(path: str | Path) -> Project:
    """The project in a folder. Raises: InputError as `parse_project`, and where there is none."""
    file = folder_of(path) / PROJECT_FILE
    return parse_project(read_text(file, most=DOCUMENT, what="project", expected="YAML"), str(file))


@dataclass
class Held:
    """A project while nobody else writes it."""

    folder: Path
    project: Project

    def write(self, project: Project, *, command: str, results: Mapping[str, str] | None = None) -> Project:
        """Write it, with results (text by file below the folder) and the command, where there is one, in its journal.

        Raises: InputError for what a project cannot be, and where it cannot be written: then it is as it was.
        """
        check_project(project)
        check_frames(project)
        journal = (*project.journal, *([Entry(at=now(), command=command)] if command else []))
        more = max(0, len(journal) - MOST_OF_JOURNAL)
        written = replace(project, version=__version__, journal=journal[more:], earlier=project.earlier + more)
        text = project_text(written)
        if results:
            _make_folder(self.folder / RESULTS)
        for file, content in (results or {}).items():
            if not (self.folder / file).exists():
                write_text(content, self.folder / file)
        if results:
            _sync(self.folder / RESULTS)
        write_text(text, self.folder / PROJECT_FILE, force=True)
        _sync(self.folder)
        _tidy(self.folder, written)
        self.project = written
        return written


@contextmanager
def writing(path: str | Path, *, wait_s: float = WAIT_S) -> Iterator[Held]:
    """The project of a folder, to be written. Raises: InputError as `read_project`, and where another writes it."""
    folder = folder_of(path)
    with locked(folder, wait_s=wait_s):
        yield Held(folder, read_project(folder))


def update(path: str | Path, edit: Callable[[Project], Project], *, command: str) -> Project:
    """A project edited: read, changed by `edit`, written. Raises: as `writing`, and as `edit`."""
    with writing(path) as held:
        return held.write(edit(held.project), command=command)


def create(path: str | Path, project: Project, *, command: str, results: Mapping[str, str] | None = None) -> Project:
    """A new project in a folder, which is made where it is not there. Raises: InputError where one is there already."""
    folder = Path(path).expanduser()
    check_project(project)
    check_frames(project)
    _make_folder(folder)
    with locked(folder):
        if (folder / PROJECT_FILE).exists():
            raise InputError(f"there is a project in {folder} already; nothing was changed. Take another folder")
        made = replace(project, created=project.created or now())
        return Held(folder, made).write(made, command=command, results=results)


def now() -> str:
    """The time, UTC."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def kept_result(
    result: CalibrationResult, *, of: str, name: str, key: str = "", robots: Sequence[str] = ()
) -> tuple[Kept, str]:
    """How a project keeps a result, and the text of its file."""
    text = result_text(result) + "\n"
    sha = hashlib.sha256(text.encode()).hexdigest()
    file = f"{RESULTS}/{of}-{sha[:16]}.json"
    return Kept(of=of, name=name, file=file, sha256=sha, key=key, made=now(), robots=tuple(robots)), text


def trouble_of(folder: Path, kept: Kept) -> str:
    """What is wrong with a result's file; empty where it is as it was written."""
    path = folder / kept.file
    if not path.exists():
        return "its file is gone"
    with open_file(path, what="result") as stream:
        same = hashlib.file_digest(stream, "sha256").hexdigest() == kept.sha256
    return "" if same else "its file was changed by another hand"


def read_kept(folder: Path, kept: Kept) -> CalibrationResult:
    """A result of the project. Raises: InputError where its file is gone, or not as it was written."""
    trouble = trouble_of(folder, kept)
    if trouble:
        raise InputError(
            f"{folder / kept.file}, the result of {kept.name}: {trouble}; calibrant project solve makes it anew"
        )
    return read_result(folder / kept.file)


def placing_results(folder: Path, project: Project) -> list[tuple[Kept, CalibrationResult]]:
    """The results that say where things are, as `frames.Scene` takes them. Raises: InputError as `read_kept`."""
    return [(kept, read_kept(folder, kept)) for kept in project.results if kept.of in ("given", "cell")]


def inside(folder: Path, given: str | Path) -> str:
    """A path as the project keeps it: from its folder where it lies below, else whole."""
    path = Path(os.path.abspath(Path(given).expanduser()))
    try:
        return path.relative_to(os.path.abspath(folder)).as_posix()
    except ValueError:
        return path.as_posix()


def outside(folder: Path, kept: str) -> Path:
    """Where a path of the project is, from here."""
    return folder / kept


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder {folder}: {error.strerror or error}") from None


def _sync(folder: Path) -> None:
    """The names in a folder on the disk, where the system can be asked for that."""
    with suppress(OSError, AttributeError):
        number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(number)
        finally:
            os.close(number)


def _tidy(folder: Path, project: Project) -> None:
    """Removes results that the project names no more, and what a writer that was ended left half done."""
    named = {Path(kept.file).name for kept in project.results}
    results = folder / RESULTS
    old = [
        p for p in (results.iterdir() if results.is_dir() else ()) if _OURS.fullmatch(p.name) and p.name not in named
    ]
    drafts = [p for place in (folder, results) if place.is_dir() for p in place.iterdir() if _DRAFT.fullmatch(p.name)]
    for path in (*old, *drafts):
        with suppress(OSError):
            path.unlink()
