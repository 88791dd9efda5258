"""Which of a project's observations are one problem: all that cameras, robots, targets that stand and rigs tie."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.tasks.project.solution.seeing import ToSee, hash_of, pose_files, records_of, robot_asked
from calibrant.version import __version__

if TYPE_CHECKING:
    from calibrant.formats.projects.records import Project, Seen, Touched
    from calibrant.tasks.project.solution.seeing import Records


@dataclass(frozen=True)
class Part:
    """One problem: the observations and touches in it, and what they are of, in the project's order."""

    observations: tuple[str, ...]
    cameras: tuple[str, ...]
    projectors: tuple[str, ...]
    robots: tuple[str, ...]
    targets: tuple[str, ...]
    touches: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """It is called as its first observations."""
        return self.observations[0]

    @property
    def components(self) -> tuple[str, ...]:
        """All of it but targets."""
        return (*self.robots, *self.cameras, *self.projectors)

    @property
    def words(self) -> str:
        """ "robot ur, cameras left and right" in short: the names."""
        return ", ".join(self.components)


def parts_of(project: Project) -> tuple[Part, ...]:
    """The problems of a project, each in the order of its observations."""
    groups: list[tuple[set[str], list[str]]] = []
    for name, seen in project.observations.items():
        nodes, lists = set(_ties(project, seen)), [name]
        for group in [g for g in groups if g[0] & nodes]:
            groups.remove(group)
            nodes, lists = nodes | group[0], [*group[1], *lists]
        groups.append((nodes, lists))
    order = list(project.observations)
    return tuple(_part(project, sorted(lists, key=order.index)) for _, lists in groups)


def key_of(folder: Path, project: Project, part: Part, seen: Mapping[str, ToSee]) -> str:
    """A hash of everything that a part's result depends on, but for how its components are called.

    Raises: InputError for files of poses or lenses that are gone.
    """
    number = {name: k for k, name in enumerate([*part.components, *part.targets])}
    rigs = [[number[c] for c in project.components[r].cameras if c in number] for r in project.of_kind("rig")]
    lists: list[object] = []
    for name in part.observations:
        s = project.observations[name]
        used = [number.get(n, -1) for n in (s.camera, s.projector, s.robot, s.target)]
        poses = [[Path(r["file"]).name, r["sha256"]] for r in records_of(folder, pose_files(folder, s))]
        lists.append([seen[name].key, s.setup, used, poses, list(vars(s.notation).values())])
    components: list[object] = []
    for name in part.components:
        c = project.components[name]
        file = records_of(folder, [folder / c.file])[0]["sha256"] if c.file else ""
        lens = [c.model or project.options.model, list(c.fix or project.options.fix)]
        components.append([c.kind, file, c.name_in_file if c.file else "", c.start, lens, c.accuracy])
    more = _also_asked(folder, project, part, number)
    return hash_of([__version__, "cell", lists, components, [r for r in rigs if r], *more])


def _also_asked(folder: Path, project: Project, part: Part, number: Mapping[str, int]) -> list[object]:
    """What else a part's result depends on, where it is asked for: clocks, joints, bodies, touches, bags."""
    out: list[object] = []
    for name in dict.fromkeys(project.rig_of(c) for c in part.cameras):
        rig = project.components.get(name)
        if rig is not None and (rig.time_offsets or rig.readout or rig.fps or rig.times):
            table = records_of(folder, [folder / rig.times])[0]["sha256"] if rig.times else ""
            out.append(["clocks", rig.time_offsets, rig.readout, rig.fps, table])
    out += [["chain", asked] for r in part.robots if (asked := robot_asked(folder, project.components[r]))]
    for body in project.of_kind("body"):
        inside = [number[t] for t in project.components[body].targets if t in number]
        out += [["body", inside]] if len(inside) > 1 else []
    for name in part.touches:
        touched = project.touches[name]
        files = [r["sha256"] for r in records_of(folder, _touch_files(folder, touched))]
        on = [number.get(touched.robot, -1), number.get(touched.target, -1), touched.tool, list(touched.corners)]
        out.append(["touches", files, on, list(vars(touched.notation).values())])
    return out


def _touch_files(folder: Path, touched: Touched) -> list[Path]:
    from calibrant.formats.poses.read import files_of as named

    return named([folder / p for p in touched.poses])


def files_of(folder: Path, project: Project, part: Part, seen: Mapping[str, ToSee]) -> Records:
    """Every file that a part is made from. Raises: InputError as `key_of`."""
    poses = [f for name in part.observations for f in pose_files(folder, project.observations[name])]
    lenses = [folder / c.file for name in part.components if (c := project.components[name]).file]
    lenses += [folder / c.chain for n in part.robots if (folder / (c := project.components[n]).chain).is_file()]
    lenses += [f for name in part.touches for f in _touch_files(folder, project.touches[name])]
    found = {r["file"]: r for name in part.observations for r in seen[name].records}
    found |= {r["file"]: r for r in records_of(folder, [*poses, *lenses])}
    return tuple(found.values())


def _ties(project: Project, seen: Seen) -> Iterator[str]:
    yield from (name for name in (seen.camera, seen.projector, seen.robot) if name)
    if seen.setup != "handheld" and seen.target:
        yield seen.target
    if seen.setup == "handheld" and project.rig_of(seen.camera):
        yield project.rig_of(seen.camera)
    if seen.setup == "handheld" and project.body_of(seen.target):
        yield project.body_of(seen.target)


def _part(project: Project, lists: list[str]) -> Part:
    seen = [project.observations[name] for name in lists]
    cameras = list(dict.fromkeys(s.camera for s in seen))
    # The frame of a rig is its first camera's, and so is the root of a cell without robots.
    first = {project.rig_of(c): project.components[project.rig_of(c)].cameras for c in cameras if project.rig_of(c)}
    order = [c for rig in first.values() for c in rig if c in cameras]
    robots = {s.robot for s in seen if s.robot}
    return Part(
        tuple(lists),
        tuple(dict.fromkeys([*order, *cameras])),
        tuple(dict.fromkeys(s.projector for s in seen if s.projector)),
        tuple(name for name in project.of_kind("robot") if name in robots),
        tuple(dict.fromkeys(s.target for s in seen if s.target)),
        tuple(name for name, t in project.touches.items() if t.robot in robots),
    )
