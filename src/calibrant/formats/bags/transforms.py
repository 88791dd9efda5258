"""Transforms of a bag: the tree of frames that tf and tf_static say, and the motion of one frame in another."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.formats.bags.bag import TRANSFORMS, Bag
from calibrant.formats.bags.stamps import HEADER, seconds_of
from calibrant.geometry import rotations, se3
from calibrant.geometry.frame_tree import ancestors, way_between
from calibrant.geometry.motion import Motion

STATIC = "tf_static"
_BASES = ("base_link", "base", "base_footprint", "robot_base", "world", "map")
_TOOLS = ("tool0", "flange", "tcp", "tool", "ee_link", "ee", "gripper", "hand", "wrist_3_link", "link_8", "panda_link8")
_NORM = 0.01
"""Largest |norm - 1| of a quaternion that is one."""
_DEEPEST = 40
"""Frames on the way up, and lines of a tree that is shown."""


@dataclass(frozen=True, eq=False)
class Edge:
    """T_parent_child: as it stands (static), or at times. stamps, received: nanoseconds; T (n, 4, 4)."""

    parent: str
    child: str
    static: bool
    stamps_ns: tuple[int, ...]
    received_ns: tuple[int, ...]
    T: Array

    def motion(self, stamps: str) -> Motion:
        """At times; repeated ones once. Raises: InputError for a clock that jumps."""
        times = seconds_of(self.stamps_ns, self.received_ns, what=f"tf {self.parent} to {self.child}", stamps=stamps)
        times, first = np.unique(times, return_index=True)
        return Motion(times, self.T[first])


@dataclass(frozen=True, eq=False)
class Tree:
    """Every transform of a bag, by child; doubled: another parent of a child that has two, in turn."""

    source: str
    edges: Mapping[str, Edge]
    doubled: Mapping[str, str] = field(default_factory=dict)

    @property
    def frames(self) -> list[str]:
        """All frames."""
        return sorted({*self.edges, *(e.parent for e in self.edges.values())})

    def words(self) -> str:
        """The tree as text: a frame a line, below its parent; * moves."""
        children: dict[str, list[str]] = {}
        for child in sorted(self.edges):
            children.setdefault(self.edges[child].parent, []).append(child)
        roots = [f for f in self.frames if f not in self.edges]
        lines: list[str] = []
        todo = [(root, 0) for root in reversed(roots)]
        while todo:
            frame, depth = todo.pop()
            moves = frame in self.edges and not self.edges[frame].static
            lines.append(f"{'  ' * (depth + 1)}{frame}{' *' if moves else ''}")
            todo += [(child, depth + 1) for child in reversed(children.get(frame, []))]
        more = [f"  … ({len(lines) - _DEEPEST} more)"] if len(lines) > _DEEPEST else []
        return "\n".join([*lines[:_DEEPEST], *more, "  (* moves in its parent)"])

    def proposal(self) -> str | None:
        """BASE:TOOL as these are called most often: two that are connected and move."""
        for base in _likely(self.frames, _BASES):
            for tool in _likely(self.frames, _TOOLS):
                chain = self._chain(base, tool)
                if chain is not None and any(not e.static for e, _ in chain):
                    return f"{base}:{tool}"
        return None

    def motion(self, base: str, tool: str, *, stamps: str = HEADER) -> Motion:
        """T_base_tool over time, at the times of all its moving joints together, each interpolated.

        Raises: InputError for frames that are not there or not connected, or that nothing moves between.
        """
        for frame in (base, tool):
            if frame not in self.frames:
                raise InputError(f"{self.source} has no frame {frame!r}; its frames are\n{self.words()}")
        chain = self._chain(base, tool)
        if chain is None:
            raise InputError(
                f"{self.source}: the frames {base} and {tool} are not connected; its frames are\n{self.words()}"
            )
        moving = {id(e): e.motion(stamps) for e, _ in chain if not e.static}
        if not moving:
            raise InputError(
                f"{self.source}: nothing moves between {base} and {tool}; name the robot's base and its flange:\n"
                f"{self.words()}"
            )
        begin, end = max(m.times[0] for m in moving.values()), min(m.times[-1] for m in moving.values())
        times = np.unique(np.concatenate([m.times for m in moving.values()]))
        times = times[(times >= begin) & (times <= end)]
        if not len(times):
            raise InputError(f"{self.source}: the transforms between {base} and {tool} have no time in common")
        T = np.broadcast_to(np.eye(4), (len(times), 4, 4))
        for edge, inverted in chain:
            step = edge.T[-1:] if edge.static else moving[id(edge)].at(times)
            T = T @ (se3.inverse(step) if inverted else step)
        return Motion(times, np.ascontiguousarray(T))

    def _chain(self, base: str, tool: str) -> list[tuple[Edge, bool]] | None:
        """From base to tool: edges, and whether each is gone up, so that its inverse counts; None where there is no
        way."""
        for frame in (base, tool):
            self._require_a_way_up(frame)
        way = way_between(base, tool, self._parent)
        if way is None:
            return None
        return [*((self.edges[f], True) for f in way[0]), *((self.edges[f], False) for f in way[1])]

    def _parent(self, frame: str) -> str | None:
        edge = self.edges.get(frame)
        return None if edge is None else edge.parent

    def _require_a_way_up(self, frame: str) -> None:
        """Raises: InputError for a frame on the way up that has two parents, or a way that turns in a circle."""
        path = ancestors(frame, self._parent)
        for name in path:
            other = self.doubled.get(name)
            if other is not None:
                raise InputError(
                    f"{self.source}: the frame {name} has two parents, {self.edges[name].parent} and {other}, in turn; "
                    "record with one publisher of it"
                )
        closes = self._parent(path[-1])
        if closes is not None:
            raise InputError(f"{self.source}: the frames {' to '.join([*path, closes])} go in a circle")


def _likely(frames: Iterable[str], words: Iterable[str]) -> list[str]:
    """Frames that are called so, or end so after a robot's prefix."""
    frames = list(frames)
    return [f for word in words for f in frames if f == word or f.endswith((f"_{word}", f"/{word}"))]


def read_tree(bag: Bag) -> Tree:
    """The tree of a bag's transforms. Raises: InputError for a bag without them, and numbers that are none."""
    topics = bag.of_kind(TRANSFORMS)
    source = f"bag {bag.path}"
    if not topics:
        listed = ", ".join(f"{t.name} ({t.kind})" for t in bag.topics if t.count) or "none"
        raise InputError(f"{source} has no transforms (tf2_msgs TFMessage); its topics are {listed}")
    rows: dict[tuple[str, str, bool], tuple[list[int], list[int], list[list[float]]]] = {}
    for message in bag.messages(topics):
        static = message.topic.endswith(STATIC)
        for one in bag.read(message).transforms:
            key = (one.header.frame_id.lstrip("/"), one.child_frame_id.lstrip("/"), static)
            stamps, received, values = rows.setdefault(key, ([], [], []))
            stamps.append(_nanoseconds(one.header.stamp))
            received.append(message.received_ns)
            values.append(_numbers(one.transform))
    edges: dict[str, Edge] = {}
    doubled: dict[str, str] = {}
    for (parent, child, static), (stamps, received, values) in rows.items():
        before = edges.get(child)
        if before is not None and before.parent != parent:
            doubled[child] = parent
        elif before is None or before.static:  # what moves says more than what stood before
            edges[child] = Edge(parent, child, static, tuple(stamps), tuple(received), _poses(values, child, source))
    return Tree(source, edges, doubled)


def _numbers(transform: Any) -> list[float]:
    p, q = transform.translation, transform.rotation
    return [p.x, p.y, p.z, q.x, q.y, q.z, q.w]


def _nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _poses(values: list[list[float]], child: str, source: str) -> Array:
    """Raises: InputError for numbers that are not finite, and quaternions that are none."""
    v = np.array(values, float)
    norms = np.linalg.norm(v[:, 3:], axis=1)
    wrong = ~np.isfinite(v).all(axis=1) | ~(np.abs(norms - 1) < _NORM)
    if wrong.any():
        k = int(np.argmax(wrong))
        raise InputError(
            f"{source}: transform {k} of frame {child} is no pose: position {v[k, :3]} m, quaternion {v[k, 3:]} of "
            f"norm {norms[k]:.4g}, expected 1"
        )
    return se3.make(rotations.matrix_from_quaternion_xyzw(v[:, 3:] / norms[:, None]), v[:, :3])
