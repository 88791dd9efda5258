"""What of a project is solved, and what is stale: by hashes of all that each result was made from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import InputError
from calibrant.tasks.project.solution.parts import Part, files_of, key_of, parts_of
from calibrant.tasks.project.solution.seeing import ToSee, to_see

if TYPE_CHECKING:
    from calibrant.formats.projects.records import Kept, Project
    from calibrant.tasks.project.solution.seeing import Records

CURRENT, STALE, NEW, BROKEN = "current", "stale", "not solved yet", "cannot be solved"
_LISTED = 3


@dataclass(frozen=True)
class Stage:
    """A result of a project, and whether it is still what its inputs would give.

    of: "seen" or "cell"; name: of the observations, or the first of the part's; covers: what it is of; state: current,
    stale, not solved yet, or cannot be solved; why: in words, empty where it is current.
    """

    of: str
    name: str
    covers: tuple[str, ...]
    state: str
    why: str = ""

    @property
    def words(self) -> str:
        """What it is, in words."""
        what = "observations" if self.of == "seen" else "calibration of"
        return f"{what} {self.name if self.of == 'seen' else ', '.join(self.covers)}"


@dataclass(frozen=True, eq=False)
class Plan:
    """Every stage of a project with what it takes to make it. seen: by observations; parts, keys: of the problems."""

    stages: tuple[Stage, ...]
    seen: Mapping[str, ToSee]
    parts: tuple[Part, ...]
    keys: Mapping[str, str]
    files: Mapping[str, Records]

    def stage(self, of: str, name: str) -> Stage:
        """The stage of that kind and name."""
        return next(s for s in self.stages if (s.of, s.name) == (of, name))


def plan_of(folder: Path, project: Project) -> Plan:
    """What is solved and what is stale; every input is hashed. Without its inputs a stage cannot be solved."""
    stages: list[Stage] = []
    seen: dict[str, ToSee] = {}
    for name, given in project.observations.items():
        covers = tuple(n for n in (given.camera, given.projector) if n)
        try:
            seen[name] = to_see(folder, project, name)
        except InputError as error:
            stages.append(Stage("seen", name, covers, BROKEN, str(error)))
            continue
        state, why = _compared(folder, kept_of(project, "seen", name), seen[name].key, seen[name].records)
        stages.append(Stage("seen", name, covers, state, why))
    keys: dict[str, str] = {}
    files: dict[str, Records] = {}
    parts = parts_of(project)
    for part in parts:
        gone = [n for n in part.observations if n not in seen]
        if gone:
            why = f"observations {', '.join(gone)} cannot be made"
            stages.append(Stage("cell", part.name, part.components, BROKEN, why))
            continue
        try:
            keys[part.name] = key_of(folder, project, part, seen)
            files[part.name] = files_of(folder, project, part, seen)
        except InputError as error:
            stages.append(Stage("cell", part.name, part.components, BROKEN, str(error)))
            continue
        state, why = _compared(folder, kept_of(project, "cell", part.name), keys[part.name], files[part.name])
        stages.append(Stage("cell", part.name, part.components, state, why))
    return Plan(tuple(stages), seen, parts, keys, files)


def kept_of(project: Project, of: str, name: str) -> Kept | None:
    """The result of that kind and name; None where there is none."""
    return next((k for k in project.results if (k.of, k.name) == (of, name)), None)


def _compared(folder: Path, kept: Kept | None, key: str, now: Records) -> tuple[str, str]:
    """The state of a result, and why it is not current."""
    from calibrant.formats.projects.folder import read_kept, trouble_of

    if kept is None:
        return NEW, "nothing has been found yet"
    trouble = trouble_of(folder, kept)
    if trouble:
        return STALE, trouble
    if kept.key == key:
        return CURRENT, ""
    before = read_kept(folder, kept).inputs
    return STALE, _difference(before, now) or "an option, a component or the version of calibrant is another one"


def _difference(before: Sequence[Mapping[str, str]], now: Records) -> str:
    """Which files are new, other ones, or gone, in words; empty where all are as they were."""
    old, new = ({r["file"]: r["sha256"] for r in records} for records in (before, now))
    parts = (
        ("added", [f for f in new if f not in old]),
        ("changed", [f for f in new if f in old and old[f] != new[f]]),
        ("gone", [f for f in old if f not in new]),
    )
    return "; ".join(f"{_counted(files)} {what}: {_listed(files)}" for what, files in parts if files)


def _counted(files: Sequence[str]) -> str:
    return "1 file" if len(files) == 1 else f"{len(files)} files"


def _listed(files: Sequence[str]) -> str:
    return ", ".join(files[:_LISTED]) + (" …" if len(files) > _LISTED else "")
