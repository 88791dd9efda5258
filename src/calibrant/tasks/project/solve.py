"""Solve a project: one problem of all that is tied together; only what changed is made anew."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from calibrant.errors import CalibrantError, RefusedError, causes
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.project import ProjectOptions, command_line
from calibrant.tasks.outcome import Answer, Outcome
from calibrant.tasks.project.list import listed
from calibrant.tasks.project.shown import lines, places_table, stages_as_json

if TYPE_CHECKING:
    from pathlib import Path

    from calibrant.tasks.project.solution.solving import Solved

EXAMPLE = 'cb.project_solve(project="cell")'


@dataclass(frozen=True, kw_only=True)
class Request:
    """Find everything that a project's observations tell, in one problem of all that is tied together.

    calibrant project solve

    Boards are looked for and problems are solved where something they were made from has another content: a photo, a
    pose, an option. What is as it was is kept, and said so. A pose that was typed in gives way to the one found.
    """

    place: ProjectOptions = ProjectOptions()
    again: bool = False
    """Make everything anew, also what is not stale."""


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """What was solved. Raises: InputError where inputs are gone or another process writes; a part that is refused is
    the outcome's refusal, and the others are kept."""
    from calibrant.formats.projects.folder import folder_of
    from calibrant.tasks.project.solution.solving import solve_project

    folder = folder_of(request.place.project)
    command = command_line("project solve", request)
    solved = solve_project(folder, command=command, again=request.again, listener=listener)
    warnings = tuple(
        f"{name}: {c.name}: {' '.join(c.message.split())}"
        for name, result in solved.results.items()
        for c in result.checks
        if c.status == "warn"
    )
    return Outcome(
        answer=Answer(solved, partial(_text, solved, folder)),
        summary=partial(_shown, solved, folder),
        warnings=warnings,
        refusal=_refusal(solved),
    )


def _refusal(solved: Solved) -> CalibrantError | None:
    if not solved.refused:
        return None
    if len(solved.refused) == 1:
        return next(iter(solved.refused.values()))
    return RefusedError(causes(f"{name}: {error}" for name, error in solved.refused.items()))


def _words(solved: Solved) -> list[str]:
    made = [f"{_done(solved, s.of, s.name)}: {s.words} ({s.why})" for s in solved.made]
    kept = [f"kept: {s.words}" for s in solved.kept]
    typed = [f"{name}: the pose that was typed in gives way to the one found" for name in solved.replaced]
    return [*made, *kept, *typed]


def _done(solved: Solved, of: str, name: str) -> str:
    return "refused" if of == "cell" and name in solved.refused else "made anew"


def _verdicts(solved: Solved) -> list[str]:
    return [
        f"{name}: verdict {r.verdict}, {r.rms_px:.4f} px rms"
        if r.rms_px is not None
        else f"{name}: verdict {r.verdict}"
        for name, r in solved.results.items()
    ]


def _shown(solved: Solved, folder: Path) -> tuple[Any, ...]:
    return lines(*_words(solved), "", *_verdicts(solved), ""), places_table(listed(folder, solved.project).places)


def _text(solved: Solved, folder: Path) -> str:
    files = {k.name: str(folder / k.file) for k in solved.project.results if k.of == "cell"}
    results = {n: {"verdict": r.verdict, "file": files.get(n)} for n, r in solved.results.items()}
    whole = {
        "made": stages_as_json(solved.made),
        "kept": stages_as_json(solved.kept),
        "results": results,
        "refused": {name: str(error) for name, error in solved.refused.items()},
        "replaced": list(solved.replaced),
    }
    return json.dumps(whole, ensure_ascii=False, indent=1)
