"""What tf said lately: where a frame was in another at a moment, along any chain, interpolated between.

    R(t) = exp(s log(R_1 R_0^T)) R_0,    p(t) = p_0 + s (p_1 - p_0),    s = (t - t_0) / (t_1 - t_0)

The transform tree is that of REP 105: every frame has one parent; static ones hold for all time.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from calibrant.arrays import Array
from calibrant.geometry import se3
from calibrant.geometry.frame_tree import ancestors, way_between

KEPT_S = 10.0
"""As tf's own buffer."""
_MOST = 20_000


@dataclass(eq=False)
class _Edge:
    """parent of a frame, and where it was in it: stamps in seconds, in order, and T_parent_child of each."""

    parent: str
    static: bool
    stamps: deque[float] = field(default_factory=lambda: deque(maxlen=_MOST))
    places: deque[Array] = field(default_factory=lambda: deque(maxlen=_MOST))

    def at(self, stamp: float) -> Array | None:
        if self.static:
            return self.places[-1]
        if not self.stamps or not self.stamps[0] <= stamp <= self.stamps[-1]:
            return None
        i = bisect_left(self.stamps, stamp)
        if self.stamps[i] == stamp:
            return self.places[i]
        t0, t1 = self.stamps[i - 1], self.stamps[i]
        before, after = self.places[i - 1], self.places[i]
        return se3.retract(before, (stamp - t0) / (t1 - t0) * se3.local(before, after))


@dataclass(eq=False)
class TransformBuffer:
    """The tree as it comes in; it grows while the robot runs."""

    edges: dict[str, _Edge] = field(default_factory=dict)

    def add(self, parent: str, child: str, T_parent_child: Array, stamp: float, *, static: bool) -> None:
        """Take in one transform. A clock that jumps back starts anew."""
        edge = self.edges.get(child)
        if edge is None or edge.parent != parent or edge.static != static:
            edge = self.edges[child] = _Edge(parent, static)
        if edge.stamps and not static:
            if stamp == edge.stamps[-1]:
                return
            if stamp < edge.stamps[-1]:
                edge.stamps.clear()
                edge.places.clear()
        edge.stamps.append(stamp)
        edge.places.append(T_parent_child)
        while not static and edge.stamps[-1] - edge.stamps[0] > KEPT_S:
            edge.stamps.popleft()
            edge.places.popleft()

    def pose(self, frame: str, of: str, stamp: float) -> Array | None:
        """T_frame_of (4, 4) at a moment; None where the frames are not connected, or it is not known then."""
        way = way_between(frame, of, self._parent)
        if way is None:
            return None
        up, down = self._down(way[0][::-1], stamp), self._down(way[1], stamp)
        return None if up is None or down is None else se3.inverse(up) @ down

    def root_of(self, frame: str) -> str:
        """The top of the tree that a frame is in."""
        return ancestors(frame, self._parent)[-1]

    def moved(self, frame: str, of: str, stamp: float, seconds: float) -> tuple[float, float] | None:
        """How far `of` was from its place at a moment, at most, mm and deg, over the seconds before; None where that
        is not known."""
        moments = stamp - seconds * np.linspace(1.0, 0.0, 5)
        found = [self.pose(frame, of, float(t)) for t in moments]
        known = [T for T in found if T is not None]
        if len(known) < len(found):
            return None
        mm, deg = se3.deviation(np.array(known[:-1]), known[-1])
        return float(np.max(mm)), float(np.max(deg))

    def described(self) -> str:
        """The tree in one line, for messages."""
        return ", ".join(f"{child} in {edge.parent}" for child, edge in list(self.edges.items())[:12]) or "nothing yet"

    def _parent(self, frame: str) -> str | None:
        edge = self.edges.get(frame)
        return None if edge is None else edge.parent

    def _down(self, frames: list[str], stamp: float) -> Array | None:
        """T_common_frame of a path down from below the common frame."""
        T = np.eye(4)
        for name in frames:
            step = self.edges[name].at(stamp)
            if step is None:
                return None
            T = T @ step
        return T
