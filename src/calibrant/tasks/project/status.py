"""Say what of a project is solved, and what is stale and why."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import partial

from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.project import ProjectOptions
from calibrant.tasks.outcome import Answer, Outcome
from calibrant.tasks.project.shown import lines, stage_lines, stages_as_json

EXAMPLE = 'cb.project_status(project="cell")'
_LAST = 5


@dataclass(frozen=True, kw_only=True)
class Request:
    """What of a project is solved, what is stale and why, and the last commands of its journal. Nothing is changed.

    calibrant project status
    """

    place: ProjectOptions = ProjectOptions()


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The stages. Raises: InputError where there is no project."""
    from calibrant.formats.projects.folder import folder_of, read_project
    from calibrant.tasks.project.solution.stages import plan_of

    folder = folder_of(request.place.project)
    project = read_project(folder)
    stages = plan_of(folder, project).stages
    journal = [f"{e.at}  {e.command}" for e in project.journal]
    none = ["No observations yet: calibrant project add images NAME --camera NAME --target NAME --images photos"]
    earlier = f" of {len(journal) + project.earlier}" if len(journal) > _LAST or project.earlier else ""
    shown = partial(lines, *(stage_lines(stages) or none), "", f"The last commands{earlier}:", *journal[-_LAST:])
    text = json.dumps({"stages": stages_as_json(stages), "journal": journal}, ensure_ascii=False, indent=1)
    return Outcome(answer=Answer(stages, lambda: text), summary=shown)
