"""Check a project: is all there that it names, is it whole, and can it be solved."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from calibrant.errors import InputError, causes
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.project import ProjectOptions
from calibrant.tasks.outcome import Answer, Outcome
from calibrant.tasks.project.shown import lines

if TYPE_CHECKING:
    from pathlib import Path

    from calibrant.formats.projects.records import Project

EXAMPLE = 'cb.project_check(project="cell")'


@dataclass(frozen=True, kw_only=True)
class Request:
    """Whether everything is there that a project names: photos, poses, lenses, results as they were written.

    calibrant project check

    Exit status 0: all is there; 2: something is not, and is named. Whether results are stale, calibrant project status
    says.
    """

    place: ProjectOptions = ProjectOptions()


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """What is wrong, as the outcome's refusal. Raises: InputError where none can be read."""
    from calibrant.formats.projects.folder import folder_of, read_project

    folder = folder_of(request.place.project)
    project = read_project(folder)
    found = troubles(folder, project)
    text = json.dumps({"troubles": found}, ensure_ascii=False, indent=1)
    counts = (len(project.components), "components"), (len(project.observations), "observations")
    whole = f"All is there: {', '.join(f'{n} {what}' for n, what in counts)}, {len(project.results)} results."
    words = [f"- {t}" for t in found] or [whole]
    refusal = InputError(causes(found)) if found else None
    return Outcome(answer=Answer(found, lambda: text), summary=partial(lines, *words), refusal=refusal)


def troubles(folder: Path, project: Project) -> list[str]:
    """All that is wrong, in words; nothing where all is as it should be."""
    from calibrant.formats.projects.folder import trouble_of
    from calibrant.formats.projects.lenses import lens_in_file
    from calibrant.tasks.project.solution.stages import BROKEN, plan_of

    out = [
        f"the result of {k.name}: {trouble} ({k.file})" for k in project.results if (trouble := trouble_of(folder, k))
    ]
    for name, c in project.components.items():
        if c.file:
            try:
                lens_in_file(folder, name, c)
            except InputError as error:
                out.append(str(error))
    out += [s.why for s in plan_of(folder, project).stages if s.state == BROKEN]
    return list(dict.fromkeys(out))
