"""What must be true of a project as a whole: names that can be used, and that what is named is there."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator
from pathlib import PurePosixPath

from calibrant.errors import InputError
from calibrant.formats.projects.records import Project, Seen, Touched

LONGEST_NAME = 100
_SEPARATORS = "=:,@"
"""They part names in options, such as left=photos and base:camera."""
_RESULTS = "results"


def check_name(name: str) -> str:
    """The name, its accents in one form. Raises: InputError for one that no command could say again, or that would look
    like another."""
    plain = unicodedata.normalize("NFC", name)
    if not plain or plain != plain.strip():
        raise InputError(f"the name {name!r} is empty, or begins or ends with a blank")
    if len(plain) > LONGEST_NAME:
        raise InputError(f"the name {plain[:20] + '…'!r} has {len(plain)} letters; {LONGEST_NAME} at most")
    bad = next((c for c in plain if not c.isprintable() or unicodedata.category(c) == "Cf"), None)
    if bad is not None:
        raise InputError(f"the name {plain!r} holds a character that is not seen (U+{ord(bad):04X}); leave it out")
    parted = next((c for c in plain if c in _SEPARATORS), None)
    if parted is not None or plain.startswith("-"):
        raise InputError(
            f"the name {plain!r} {'begins with -' if parted is None else f'holds {parted!r}'}: names are parted by "
            f"{' '.join(_SEPARATORS)} in options, and a dash begins one; call it otherwise"
        )
    return plain


def check_project(project: Project) -> None:
    """Raises: InputError for a name that cannot be, two things of one name, or a thing that is used and not there."""
    for name in (*project.components, *project.observations, *project.touches):
        check_name(name)
    both = next((n for n in project.touches if n in project.observations), None)
    if both is not None:
        raise InputError(f"there are observations and touches called {both!r}; call one otherwise")
    taken: dict[str, str] = {}
    for name in project.components:
        other = taken.setdefault(name.casefold(), name)
        if other != name:
            raise InputError(f"the names {other!r} and {name!r} differ in small and capital letters alone")
    for what, name, kind in _uses(project):
        try:
            project.component(name, kind=kind)
        except InputError as error:
            raise InputError(f"{what}: {error}") from None
    for name, c in project.components.items():
        if c.kind in ("rig", "body"):
            mine = c.cameras or c.targets
            others = {m for o in project.of_kind(c.kind) if o != name for m in _members(project, o)}
            twice = next((m for m in mine if m in others or mine.count(m) > 1), None)
            if twice is not None:
                what = "camera" if c.kind == "rig" else "target"
                raise InputError(f"{c.kind} {name}: {what} {twice} stands in it twice, or in another {c.kind}")
    for kept in project.results:
        parts = PurePosixPath(kept.file).parts
        if len(parts) != 2 or parts[0] != _RESULTS or parts[1].startswith(".") or "\\" in kept.file:
            raise InputError(f"a result's file is {kept.file!r}, expected one in the project's folder {_RESULTS}")


def _uses(project: Project) -> Iterator[tuple[str, str, str]]:
    """What names which component: words for it, the name, the kind that it must be."""
    for name, c in project.components.items():
        words = f"{c.kind} {name}"
        yield from ((words, camera, "camera") for camera in c.cameras)
        yield from ((words, target, "target") for target in c.targets)
        if c.camera:
            yield words, c.camera, "camera"
        if c.robot:
            yield words, c.robot, "robot"
    for name, seen in project.observations.items():
        yield from ((f"observations {name}", used, kind) for used, kind in used_by(seen))
    for name, touched in project.touches.items():
        yield from ((f"touches {name}", used, kind) for used, kind in used_by_touches(touched))


def used_by(seen: Seen) -> tuple[tuple[str, str], ...]:
    """The components that observations name, and the kind of each."""
    named = ((seen.camera, "camera"), (seen.target, "target"), (seen.projector, "projector"), (seen.robot, "robot"))
    return tuple((name, kind) for name, kind in named if name)


def used_by_touches(touched: Touched) -> tuple[tuple[str, str], ...]:
    """The components that touches name, and the kind of each."""
    named = ((touched.tool, "tool"), (touched.robot, "robot"), (touched.target, "target"))
    return tuple((name, kind) for name, kind in named if name)


def _members(project: Project, name: str) -> tuple[str, ...]:
    """The cameras of a rig, the targets of a body."""
    return project.components[name].cameras or project.components[name].targets
