"""Where every component of a project is, in the frame of any other.

A component is a frame of its own name; of a robot that is its base, and its gripper is NAME_gripper. Where there is one
robot its frames are called "base" and "gripper" too, as results call them. A rig is at its first camera, a body at its
first target.

Poses come from the results, with their covariance, and from what was typed in or read, which stands in the place of a
result's for its own component alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calibrant.arrays import Array
from calibrant.data import CalibrationResult
from calibrant.data.renamed import with_names
from calibrant.errors import InputError
from calibrant.formats.projects.chains import covariance_between
from calibrant.formats.projects.records import Kept, Project
from calibrant.geometry import rotations, se3
from calibrant.geometry.frames import FrameGraph

BASE, GRIPPER = "base", "gripper"
ITSELF, SOLVED, NOWHERE = "the frame itself", "solved", "not known"
_BODY = "\0body "
"""No name begins so."""
_CLOSE_M = 1e-3
_CLOSE_RAD = 1e-3
"""A result's own transforms agree but for rounding; which of them a path takes makes no difference that is seen."""

Frame = tuple[str, str]
"""(parent, child)."""
Body = dict[str, Array]
"""Frames that are fixed to each other: T_body_frame by name."""
Results = Sequence[tuple[Kept, CalibrationResult]]
"""The results that say where things are, of which a later one counts more."""


@dataclass(frozen=True, eq=False)
class Place:
    """Where a component is. relative_to: the frame asked for, or where nothing leads there the one it is fixed to; T
    (4, 4) metres, None for one that is nowhere; source: "solved", "typed in", or the file that says so, or several of
    these where it rests on several.
    """

    name: str
    kind: str
    relative_to: str
    T: Array | None
    source: str
    covariance: Array | None = None

    @property
    def xyz_mm(self) -> Array | None:
        """Its origin, millimetres."""
        return None if self.T is None else 1e3 * self.T[:3, 3]

    @property
    def ypr_deg(self) -> Array | None:
        """Yaw, pitch, roll (z-y'-x''), degrees."""
        return None if self.T is None else rotations.yaw_pitch_roll_from_matrix(self.T[:3, :3], unit="deg")

    @property
    def sigma_mm(self) -> Array | None:
        """1 sigma of the origin along the axes of `relative_to`; None where nothing tells it."""
        return None if self.covariance is None else 1e3 * np.sqrt(np.diag(self.covariance)[3:])

    @property
    def sigma_deg(self) -> Array | None:
        """1 sigma of the rotation about the axes of `relative_to`."""
        return None if self.covariance is None else np.rad2deg(np.sqrt(np.diag(self.covariance)[:3]))


def frames_of(project: Project) -> tuple[str, ...]:
    """Every frame that can be named."""
    grippers = [f"{robot}_{GRIPPER}" for robot in project.of_kind("robot")]
    return tuple(dict.fromkeys([*project.components, *grippers]))


def frame_named(project: Project, name: str) -> str:
    """The frame that a name stands for. Raises: InputError listing those that there are."""
    component = project.components.get(name)
    if component is not None:
        return (*component.cameras, *component.targets, name)[0]
    robots = project.of_kind("robot")
    if len(robots) == 1 and name in (BASE, GRIPPER):
        return robots[0] if name == BASE else f"{robots[0]}_{GRIPPER}"
    if name in frames_of(project):
        return name
    also = [BASE, GRIPPER] if len(robots) == 1 else []
    listed = ", ".join([*frames_of(project), *also]) or "none; add one: calibrant project add frame table"
    raise InputError(f"the project has no component called {name!r}; there are: {listed}")


def check_frames(project: Project) -> None:
    """Raises: InputError for a frame that is named and not there, and for poses that turn in a circle."""
    for robot in project.of_kind("robot"):
        if f"{robot}_{GRIPPER}" in project.components:
            raise InputError(f"a component cannot be called {robot}_{GRIPPER}: the gripper of {robot} is called so")
    if project.world:
        frame_named(project, project.world)
    parents: dict[str, str] = {}
    for name, c in project.components.items():
        if c.shown_in:
            frame_named(project, c.shown_in)
        if c.pose is not None:
            parents[frame_named(project, name)] = frame_named(project, c.pose.relative_to)
    for name in parents:
        seen = [name]
        while (above := parents.get(seen[-1])) is not None:
            if above in seen:
                turn = " -> ".join([*seen[seen.index(above) :], above])
                raise InputError(
                    f"the poses that are given turn in a circle: {turn}; give one relative to another frame"
                )
            seen.append(above)


def world_of(project: Project) -> str:
    """The frame that poses are shown in: as chosen, else a robot's base, else the first component."""
    if project.world:
        return frame_named(project, project.world)
    first = next(iter(project.of_kind("robot")), None) or next(iter(project.components), "")
    return frame_named(project, first) if first else ""


def names_in(kept: Kept) -> Mapping[str, str]:
    """What a result calls the frames of its robots, and what the project does."""
    if len(kept.robots) == 1:
        return {BASE: kept.robots[0], GRIPPER: f"{kept.robots[0]}_{GRIPPER}"}
    return {f"{robot}_{BASE}": robot for robot in kept.robots}


@dataclass(frozen=True, eq=False)
class Scene:
    """All that is known of where things are: bodies of frames that results tell, and poses that were given.

    graph: a node for each body, an edge from it to each of its frames, and the poses that were given.
    """

    project: Project
    graph: FrameGraph
    given: Mapping[Frame, str]
    results: tuple[CalibrationResult, ...]

    @classmethod
    def of(cls, project: Project, results: Results) -> Scene:
        """The scene of a project. Raises: InputError where a result contradicts itself."""
        latest_first = tuple(with_names(result, names_in(kept)) for kept, result in reversed(results))
        bodies: list[Body] = []
        for result in latest_first:
            for body in _bodies_in(result):
                bodies = _taken_in(bodies, body)
        edges: dict[Frame, Array] = {}
        given: dict[Frame, str] = {}
        for name, c in project.components.items():
            if c.pose is None:
                continue
            frame, parent = frame_named(project, name), frame_named(project, c.pose.relative_to)
            if _instead(project, _graph(bodies, edges), frame, parent):
                bodies = [{f: T for f, T in body.items() if f != frame} for body in bodies]
            edges[parent, frame] = c.pose.matrix
            given[parent, frame] = c.pose.source
        return cls(project, _graph(bodies, edges), given, latest_first)

    def place(self, name: str, world: str) -> Place:
        """Where a component is in a frame, or, where nothing leads there, in what it is fixed to. Raises: InputError
        for names that are not there."""
        project = self.project
        kind = project.components[name].kind if name in project.components else "frame"
        frame, world = frame_named(project, name), frame_named(project, world)
        if frame == world:
            return Place(name, kind, world, np.eye(4), ITSELF)
        if frame not in self.graph.frames:
            return Place(name, kind, world, None, NOWHERE)
        group = [f for f in next(g for g in self.graph.groups() if frame in g) if not f.startswith(_BODY)]
        grippers = [f for f in group if f in self._grippers]
        parent = world if world in group else next(iter([*grippers, *group]))
        if parent == frame:
            return Place(name, kind, frame, np.eye(4), ITSELF)
        path = self.graph.path(parent, frame)
        steps = list(pairwise(path))
        sources = [self.given.get((a, b)) or self.given.get((b, a)) or SOLVED for a, b in steps]
        covariance = self._covariance(parent, frame) if set(sources) == {SOLVED} else None
        return Place(
            name, kind, parent, self.graph.T(parent, frame), ", ".join(dict.fromkeys(reversed(sources))), covariance
        )

    def places(self, world: str = "") -> tuple[Place, ...]:
        """Every component in a frame; in the one that it is shown in where none is said."""
        shown = world_of(self.project)
        return tuple(self.place(name, world or c.shown_in or shown) for name, c in self.project.components.items())

    @property
    def _grippers(self) -> set[str]:
        return {f"{robot}_{GRIPPER}" for robot in self.project.of_kind("robot")}

    def _covariance(self, parent: str, child: str) -> Array | None:
        """As the last result that has both frames tells it."""
        for result in self.results:
            frames = {name for t in result.transforms for name in (t.parent, t.child)}
            if {parent, child} <= frames:
                return covariance_between(result, parent, child)
        return None


def _instead(project: Project, known: FrameGraph, frame: str, parent: str) -> bool:
    """Whether a pose that is given stands in the place of what is known of its frame, and does not join two bodies:
    where they are one already, or would tie a robot's base to its own gripper, which moves."""
    groups = known.groups()
    mine, others = (next((g for g in groups if name in g), (name,)) for name in (frame, parent))
    if parent in mine:
        return True
    joined = {*mine, *others}
    return any({robot, f"{robot}_{GRIPPER}"} <= joined for robot in project.of_kind("robot"))


def _graph(bodies: Sequence[Body], edges: Mapping[Frame, Array]) -> FrameGraph:
    graph = FrameGraph()
    for k, body in enumerate(bodies):
        for name, T in body.items():
            graph = graph.add(f"{_BODY}{k}", name, T)
    for (parent, child), T in edges.items():
        graph = graph.add(parent, child, T)
    return graph


def _bodies_in(result: CalibrationResult) -> Iterator[Body]:
    """The frames of a result that it ties together, in the frame of the first."""
    graph = FrameGraph(tolerance_m=_CLOSE_M, tolerance_rad=_CLOSE_RAD)
    for t in result.transforms:
        graph = graph.add(t.parent, t.child, t.matrix)
    for group in graph.groups():
        yield {name: np.eye(4) if name == group[0] else graph.T(group[0], name) for name in group}


def _taken_in(bodies: Sequence[Body], more: Body) -> list[Body]:
    """The bodies with what an older result adds: where it has a frame with them in common, it is placed by that, and
    says nothing of the others that they have."""
    out: list[Body] = []
    whole: Body = {}
    for body in bodies:
        shared = next((name for name in body if name in more), None)
        if shared is None:
            out.append(body)
            continue
        # Into the frame of what is newer: T_whole_body = T_whole_shared T_body_shared^-1.
        at = more[shared] @ se3.inverse(body[shared])
        whole = {**whole, **{name: at @ T for name, T in body.items() if name not in whole}}
    return [*out, {**more, **whole}] if whole else [*out, more]
