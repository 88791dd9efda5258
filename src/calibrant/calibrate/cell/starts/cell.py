"""The closed-form start of a cell: each list of pictures alone, then joined.

Pictures with a robot between camera and target are a hand-eye problem A_i X B_i = Z of their own; the transforms that
these give are the edges of a graph, in which every unknown is a path. A camera whose own motions determine nothing
(few pictures, one place) is found through a target that another camera has found, X = A_i^-1 Z B_i^-1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.problem.layout import HAND_TO_HAND, STANDING, Frame, Layout, Pictures
from calibrant.calibrate.cell.problem.views import HandEyeViews
from calibrant.calibrate.cell.starts.hand_to_hand import hand_to_hand_start
from calibrant.calibrate.cell.starts.handheld import CameraPair, handheld_start
from calibrant.calibrate.cell.starts.medoid import medoid
from calibrant.calibrate.cell.starts.robust import agreeing_group, disagreement
from calibrant.calibrate.cell.starts.seed import MOST_GROSS, Seed, best_seed, seed_of_all, setup_check
from calibrant.calibrate.cell.starts.touches import touched_start
from calibrant.calibrate.solvers.motion import MotionReport, motion_report
from calibrant.calibrate.solvers.setup import SETUPS, Setup, get_setup
from calibrant.cancel import checkpoint
from calibrant.data import Check
from calibrant.errors import RefusedError
from calibrant.geometry import se3
from calibrant.geometry.frames import FrameGraph

LEVEL_START = (1e-3, 1e-3)
"""A milliradian and a millimetre: where no list of pictures tells by itself how well its loop closes."""


@dataclass(frozen=True, eq=False)
class Alone:
    """What a list of pictures says by itself: its motions, its closed form, and whether its setup is the right one."""

    report: MotionReport
    seed: Seed
    setup: Check


@dataclass(frozen=True, eq=False)
class CellStart:
    """Transforms by (parent, child), those of handheld targets (m, 4, 4); the data without gross outliers; spread: the
    loop's typical error, rad and m.

    alone: what each list that determines something by itself says; refused: why the others do not, both by the list's
    number. pairs: the pairs of cameras that lead through a rig.
    """

    transforms: dict[Frame, Array]
    data: tuple[HandEyeViews, ...]
    spread: tuple[float, float]
    alone: Mapping[int, Alone]
    refused: Mapping[int, str]
    pairs: tuple[CameraPair, ...] = ()


def cell_start(layout: Layout, data: Sequence[HandEyeViews], missing: Mapping[str, str]) -> CellStart:
    """missing: views that are not in the data, and why. Raises: RefusedError naming what no path leads to, and why the
    pictures that could tell do not; or the list whose setup is another one than was said."""
    if layout.rig:
        places, pairs = handheld_start(layout, data)
        return CellStart(places, tuple(data), LEVEL_START, {}, {}, pairs)
    graph, by_hand = _tied_by_hand(layout, data, FrameGraph(tolerance_m=np.inf, tolerance_rad=np.inf))
    cleaned = list(data)
    refused: dict[int, str] = {}
    alone: dict[int, Alone] = {}
    spreads = []
    # The longest list first: of two ways to a frame the first one stays.
    order = sorted(range(len(data)), key=lambda i: -int(data[i].use.sum()))
    for i in order:
        checkpoint()
        p = layout.pictures[i]
        if p.handheld:
            continue
        if p.setup == STANDING:
            graph = graph.add(p.camera, layout.target(p), medoid(data[i].B[data[i].use]))
            continue
        try:
            if p.setup == HAND_TO_HAND:
                found = hand_to_hand_start(*_both_arms(layout, p, data[i]))
                spreads.append(found.spread)
                edges = _hand_to_hand_edges(layout, p)
                graph = _add(graph, edges, (found.X, found.W, found.Z))
                continue
            cleaned[i], alone[i] = _alone(p, data[i], missing if len(data) == 1 else {})
        except RefusedError as error:
            refused[i] = str(error)
            continue
        seed = alone[i].seed
        spreads.append((np.deg2rad(seed.loop.median_deg), 1e-3 * seed.loop.median_mm))
        graph = _add(graph, layout.constants(p), (seed.X, seed.Z), tied=bool(by_hand))
    if len(data) == 1 and refused and not layout.touches:
        raise RefusedError(refused[0])
    for i, said in sorted(alone.items()):
        if said.setup.status == "fail":
            raise RefusedError(f"{layout.prefix(i)}{said.setup.name}: {said.setup.message}")
    graph = touched_start(layout, _through_others(layout, cleaned, graph, refused))
    transforms = {}
    # Robots first: where nothing ties them, that is what a person has to know.
    for parent, child in reversed(layout.unknown):
        if not _connected(graph, parent, child):
            raise RefusedError(_missing(layout, parent, child, refused))
        transforms[parent, child] = graph.T(parent, child)
    median = np.median(np.array(spreads), axis=0) if spreads else np.array(LEVEL_START)
    transforms = {f: transforms[f] for f in layout.unknown}
    for part in by_hand:
        transforms |= part.carriers(graph)
    pairs = tuple(pair for part in by_hand for pair in part.pairs)
    return CellStart(transforms, tuple(cleaned), (float(median[0]), float(median[1])), alone, refused, pairs)


@dataclass(frozen=True, eq=False)
class _ByHand:
    """Cameras that handheld targets tie, the first their reference: where the targets were in it, (m, 4, 4) by moment.

    frames: those of the carriers in the layout, each with its name in the part."""

    reference: str
    frames: Mapping[Frame, Frame]
    places: Mapping[Frame, Array]
    pairs: tuple[CameraPair, ...]

    def carriers(self, graph: FrameGraph) -> dict[Frame, Array]:
        """The targets' places in what the cameras are fixed to."""
        return {f: graph.T(f[0], self.reference) @ self.places[mine] for f, mine in self.frames.items()}


def _tied_by_hand(
    layout: Layout, data: Sequence[HandEyeViews], graph: FrameGraph
) -> tuple[FrameGraph, tuple[_ByHand, ...]]:
    """The graph with the cameras that handheld targets tie to each other: each group is a rig of its own.

    Raises: RefusedError naming what shares no moment with the rest.
    """
    parts = []
    for group in layout.by_hand:
        mine = [k for k, p in enumerate(layout.pictures) if p.handheld and p.camera in group]
        # As a rig of its own a target has its own frame: two that are one name stay two.
        lists = [replace(p, target=layout.target(p)) for p in (layout.pictures[k] for k in mine)]
        seen = {layout.pictures[k].target: p.target for k, p in zip(mine, lists)}
        rigid = tuple(tuple(seen[name] for name in names) for names in layout.rigid if names[0] in seen)
        rig = Layout({}, tuple(lists), group[0], rigid)
        places, pairs = handheld_start(rig, [data[k] for k in mine])
        for frame in rig.unknown:
            graph = graph.add(*frame, places[frame])
        bodies = {rig.carrier(p): layout.camera_parent(p) for p in lists}
        frames = {(body, carrier): (group[0], carrier) for carrier, body in bodies.items()}
        parts.append(_ByHand(group[0], frames, places, pairs))
    return graph, tuple(parts)


def _add(graph: FrameGraph, edges: Sequence[Frame], transforms: Sequence[Array], *, tied: bool = False) -> FrameGraph:
    """The graph with these edges; tied: without those whose ends are tied already, as by targets moved by hand."""
    for (parent, child), T in zip(edges, transforms):
        if not (tied and _connected(graph, parent, child)):
            graph = graph.add(parent, child, T)
    return graph


def _both_arms(layout: Layout, p: Pictures, data: HandEyeViews) -> tuple[Array, Array, Array]:
    """A, C and B of the used views of a camera on one robot and a target on another."""
    other = layout.robots[p.other]
    index = {name: k for k, name in enumerate(other.ids)}
    C = other.T_base_gripper[[index[i] for i, use in zip(data.ids, data.use) if use]]
    return data.T_base_gripper[data.use], C, data.B[data.use]


def _hand_to_hand_edges(layout: Layout, p: Pictures) -> tuple[Frame, Frame, Frame]:
    """Camera in gripper, the other robot's base in this one's, target in the other's gripper."""
    return (
        (layout.gripper(p.robot), p.camera),
        (layout.base(p.robot), layout.base(p.other)),
        (layout.gripper(p.other), layout.target(p)),
    )


def _alone(p: Pictures, data: HandEyeViews, missing: Mapping[str, str]) -> tuple[HandEyeViews, Alone]:
    """A list's closed form, and the list without views far from where the others put the target.

    Raises: RefusedError for motions or views that determine nothing.
    """
    setup, used = get_setup(p.setup), data.use
    out = data.missing | dict(missing)
    if used.sum() < 3:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in out.items())
        raise RefusedError(
            f"poses: {int(used.sum())} usable poses of {len(data) + len(missing)}, at least 3 are needed, better 10 to "
            "20" + (f" ({reasons})" if reasons else "")
        )
    A, B = setup.normal_form(data.T_base_gripper[used]), data.B[used]
    report = motion_report(A, B, frame=setup.camera_parent)
    report.require_determined()
    seed = best_seed(A, B, certainty=data.certainty[used])
    if any(f.status == "fail" for f in report.findings):
        report = _report_of_group(A, B, data, setup, report)
    if not seed.keep.all():
        dropped = np.zeros(len(data), dtype=bool)
        dropped[np.flatnonzero(used)[~seed.keep]] = True
        data = data.without(dropped, _gross_reasons(setup, data, seed))
    return data, Alone(report, seed, setup_check(setup, seed, _other_seed(setup, data)))


def _report_of_group(A: Array, B: Array, data: HandEyeViews, setup: Setup, report: MotionReport) -> MotionReport:
    """The report about the views that agree, where only some of them disagree; the report as it is where none agree.

    Raises: RefusedError where a third or more disagree, naming how many agree and the others.
    """
    group = agreeing_group(A, B, certainty=data.certainty[data.use])
    if group is None or group.members.all():
        return report
    n, k = len(A), int(group.members.sum())
    if n - k > int(MOST_GROSS * n):
        others = [name for name, member in zip(np.array(data.ids)[data.use].tolist(), group.members) if not member]
        raise RefusedError(f"views-disagree: {disagreement(n, group, others)}")
    of_group = motion_report(A[group.members], B[group.members], frame=setup.camera_parent)
    of_group.require_determined()
    return of_group


def _gross_reasons(setup: Setup, data: HandEyeViews, seed: Seed) -> list[str | None]:
    mm, deg = se3.deviation(seed.Z, setup.normal_form(data.T_base_gripper) @ seed.X @ data.B)
    return [
        f"it puts the target {away:.3g} mm and {turned:.3g} deg from where the others do ({seed.loop.median_mm:.2g} "
        f"mm, {seed.loop.median_deg:.2g} deg typically); wrong pose, wrong image, or a misread board"
        for away, turned in zip(mm, deg)
    ]


def _other_seed(setup: Setup, data: HandEyeViews) -> Seed | None:
    other = next(s for s in SETUPS.values() if s.name != setup.name)
    try:
        return seed_of_all(other.normal_form(data.T_base_gripper[data.use]), data.B[data.use])
    except RefusedError:  # no closed form has an answer: this setup is the only one
        return None


def _through_others(
    layout: Layout, data: Sequence[HandEyeViews], graph: FrameGraph, refused: dict[int, str]
) -> FrameGraph:
    """Cameras and targets that only another camera's or target's place tells, until nothing more is found."""
    left = set(refused)
    while True:
        before = set(left)
        for i in sorted(left):
            p, used = layout.pictures[i], data[i].use
            if not used.any():
                continue
            if p.setup == HAND_TO_HAND:
                graph, done = _third(layout, p, data[i], graph)
                left -= {i} if done else set()
                continue
            (at, camera), (on, target) = layout.constants(p)
            if layout.by_hand and _connected(graph, on, target) and _connected(graph, at, camera):
                left.discard(i)
                continue
            A, B = get_setup(p.setup).normal_form(data[i].T_base_gripper[used]), data[i].B[used]
            if _connected(graph, on, target):
                X = se3.inverse(A) @ graph.T(on, target) @ se3.inverse(B)
                graph = graph.add(at, camera, medoid(X))
            elif _connected(graph, at, camera):
                graph = graph.add(on, target, medoid(A @ graph.T(at, camera) @ B))
            else:
                continue
            left.discard(i)
        if left == before:
            return graph


def _third(layout: Layout, p: Pictures, data: HandEyeViews, graph: FrameGraph) -> tuple[FrameGraph, bool]:
    """With two of X, W, Z of A_i X B_i = W C_i Z known by other pictures, the third; and whether that was so."""
    A, C, B = _both_arms(layout, p, data)
    edges = _hand_to_hand_edges(layout, p)
    known = [graph.T(*e) if _connected(graph, *e) else None for e in edges]
    X, W, Z = known
    if X is not None and W is not None and Z is None:
        return graph.add(*edges[2], medoid(se3.inverse(W @ C) @ A @ X @ B)), True
    if X is not None and Z is not None and W is None:
        return graph.add(*edges[1], medoid(A @ X @ B @ se3.inverse(C @ Z))), True
    if W is not None and Z is not None and X is None:
        return graph.add(*edges[0], medoid(se3.inverse(A) @ W @ C @ Z @ se3.inverse(B))), True
    return graph, all(T is not None for T in known)


def _connected(graph: FrameGraph, parent: str, child: str) -> bool:
    return any(parent in group and child in group for group in graph.groups())


def _missing(layout: Layout, parent: str, child: str, refused: dict[int, str]) -> str:
    reasons = "; ".join(f"{layout.pictures[i].words}: {text}" for i, text in refused.items())
    if reasons:
        return f"nothing tells where {child} is in {parent}: {reasons}"
    if (parent, child) in layout.positions:
        return (
            f"the touches do not tell where {child} is in {parent}: touch one point four times or more, the tool "
            "tilted about two axes in between, or places of a target that cameras find"
        )
    if child in layout.cameras:
        return (
            f"nothing tells where {child} is in {parent}: no robot moves it or a target before it, and it sees no "
            "handheld target together with a camera that one does; add such pictures, or leave it out"
        )
    return (
        f"nothing ties {child} to {parent}: the robots share neither a camera that sees what both carry nor a target "
        "that both see; add pictures that do, or calibrate them apart"
    )
