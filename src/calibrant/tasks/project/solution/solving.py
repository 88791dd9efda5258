"""A project solved: what is stale is made anew, what is not is kept, and each result is written when it is there.

solved = solve_project(Path("cell"), command="calibrant project solve")
solved.made, solved.kept              # the stages, with the reason of those that were made
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.cancel import checkpoint
from calibrant.errors import CalibrantError, InputError, RefusedError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.project.solution.part_solving import solved_part
from calibrant.tasks.project.solution.seeing import seen_now
from calibrant.tasks.project.solution.sources import from_folder
from calibrant.tasks.project.solution.stages import BROKEN, CURRENT, Plan, Stage, kept_of, plan_of

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult, Observations
    from calibrant.formats.projects.folder import Held
    from calibrant.formats.projects.records import Project
    from calibrant.tasks.project.solution.parts import Part


@dataclass(frozen=True, eq=False)
class Solved:
    """What solving a project did. made, kept: its stages; results: of every part, by the name of its first
    observations; refused: by part, why it has no result; replaced: components whose typed pose a result took over."""

    project: Project
    made: tuple[Stage, ...]
    kept: tuple[Stage, ...]
    results: dict[str, CalibrationResult]
    refused: dict[str, CalibrantError]
    replaced: tuple[str, ...]


def solve_project(path: str | Path, *, command: str, again: bool = False, listener: Listener = SILENT) -> Solved:
    """Find all that a project's observations tell. again: also what is not stale.

    Nobody else writes the project meanwhile. A part that is refused leaves its result of before, and the others are
    solved all the same. Raises: InputError where there is nothing to solve, inputs are gone, or another process writes.
    """
    from calibrant.formats.projects.folder import writing

    with writing(path) as held:
        plan = _plan(held, again=again)
        made: list[Stage] = [s for s in plan.stages if s.state != CURRENT]
        observations = _every_seen(held, plan, listener)
        results: dict[str, CalibrationResult] = {}
        refused: dict[str, CalibrantError] = {}
        replaced: list[str] = []
        for part in plan.parts:
            checkpoint()
            if plan.stage("cell", part.name) not in made:
                results[part.name] = _kept_result(held, "cell", part.name)
                continue
            try:
                results[part.name] = _solved(held, plan, part, observations, listener)
            except (RefusedError, InputError) as error:
                refused[part.name] = error
                continue
            replaced += _keep(held, plan, part, results[part.name])
        _leave_out_others(held, plan)
        held.write(held.project, command=command)
        kept = tuple(s for s in plan.stages if s not in made)
        return Solved(held.project, tuple(made), kept, results, refused, tuple(replaced))


def _plan(held: Held, *, again: bool) -> Plan:
    """Raises: InputError where there is nothing to solve, or something is gone."""
    if not held.project.observations:
        raise InputError(
            "the project has no observations: add some, such as calibrant project add images front --camera front "
            "--target board --images photos/*.png"
        )
    with_all = plan_of(held.folder, held.project)
    broken = [s for s in with_all.stages if s.state == BROKEN]
    loose = [n for n in held.project.touches if not any(n in part.touches for part in with_all.parts)]
    if loose:
        raise InputError(
            f"touches {', '.join(loose)}: their robot has no pictures in the project, and calibrant tool touch needs "
            "none: add pictures at its poses, or remove the touches"
        )
    if broken:
        what = "; ".join(dict.fromkeys(s.why for s in broken if s.of == "seen")) or "; ".join(s.why for s in broken)
        raise InputError(f"{what}. Nothing was solved, and the results of before stay as they are")
    if not again:
        return with_all
    stages = tuple(
        replace(s, state="stale", why="asked for again") if s.state == CURRENT else s for s in with_all.stages
    )
    return replace(with_all, stages=stages)


def _every_seen(held: Held, plan: Plan, listener: Listener) -> dict[str, Observations]:
    """The observations, found anew where they are stale, and written."""
    from calibrant.formats.projects.edits import with_kept
    from calibrant.formats.projects.folder import kept_result

    out: dict[str, Observations] = {}
    for name, what in plan.seen.items():
        checkpoint()
        if plan.stage("seen", name).state == CURRENT:
            found = _kept_result(held, "seen", name)
        else:
            found = seen_now(held.folder, held.project, what, listener)
            kept, text = kept_result(found, of="seen", name=name, key=what.key)
            held.write(with_kept(held.project, kept), command="", results={kept.file: text})
        if found.observations is None:
            raise InputError(f"the kept observations {name} hold none; calibrant project solve --again makes them anew")
        out[name] = found.observations
    return out


def _solved(held: Held, plan: Plan, part: Part, seen: dict[str, Observations], listener: Listener) -> CalibrationResult:
    session.load_solver(listener)
    found = solved_part(held.folder, held.project, part, {n: seen[n] for n in part.observations}, listener)
    found = _from_folder(held.folder, found)
    return session.with_misses(replace(found, inputs=plan.files[part.name]))


def _from_folder(folder: Path, found: CalibrationResult) -> CalibrationResult:
    """The result with its images as the project's folder calls them, so that it may be moved."""
    seen = found.observations
    if seen is None:
        return found
    views = tuple(replace(v, file=from_folder(folder, v.file)) for v in seen.views)
    missed = tuple(replace(m, file=from_folder(folder, m.file)) for m in seen.missed)
    return replace(found, observations=replace(seen, views=views, missed=missed))


def _keep(held: Held, plan: Plan, part: Part, result: CalibrationResult) -> list[str]:
    """The result written; what it places is no longer where it was typed in. Returns the names of those."""
    from calibrant.formats.projects.edits import with_kept
    from calibrant.formats.projects.folder import kept_result

    kept, text = kept_result(result, of="cell", name=part.name, key=plan.keys[part.name], robots=part.robots)
    project = with_kept(held.project, kept)
    placed = {t.child for t in result.transforms}
    typed = [n for n in (*part.components, *part.targets) if n in placed and project.components[n].pose is not None]
    components = {n: replace(c, pose=None) if n in typed else c for n, c in project.components.items()}
    held.write(replace(project, components=components), command="", results={kept.file: text})
    return typed


def _kept_result(held: Held, of: str, name: str) -> CalibrationResult:
    from calibrant.formats.projects.folder import read_kept

    kept = kept_of(held.project, of, name)
    if kept is None:
        raise InputError(f"no result of {name} is kept")
    return read_kept(held.folder, kept)


def _leave_out_others(held: Held, plan: Plan) -> None:
    """Results of problems that there are no more are left out: what they were of is in another one, or gone."""
    names = {("cell", part.name) for part in plan.parts} | {("seen", name) for name in plan.seen}
    results = tuple(k for k in held.project.results if k.of == "given" or (k.of, k.name) in names)
    held.project = replace(held.project, results=results)
