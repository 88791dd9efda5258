"""Frames that know each other through transforms: any one relative to any other, by the shortest path.

    T_a_d = T_a_b T_b_c T_c_d along the path a, b, c, d; an edge walked from child to parent is inverted.

The named equations of the documents are in `grasp_equations`; they are paths through such a graph.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import se3, so3

_ROUNDING_M = 1e-6
_ROUNDING_RAD = 1e-6
"""Two ways to the same transform may differ by what a file with six decimals (metres, radians) rounds away."""


@dataclass(frozen=True, eq=False)
class FrameGraph:
    """Frames and the transforms between them; `add` returns a larger graph and leaves this one as it is.

    Start with `FrameGraph()`. A transform may carry leading axes, (n, 4, 4), for n moments; they broadcast.
    tolerance_m, tolerance_rad: by how much two paths between the same frames may differ before `add` refuses.

        >>> import calibrant as cb, numpy as np
        >>> graph = cb.FrameGraph().add("base", "gripper", np.eye(4)).add("gripper", "camera", np.eye(4))
        >>> graph.frames
        ('base', 'gripper', 'camera')
    """

    tolerance_m: float = _ROUNDING_M
    tolerance_rad: float = _ROUNDING_RAD
    transforms: Mapping[tuple[str, str], Array] = field(default_factory=lambda: MappingProxyType({}), init=False)
    """T_parent_child by (parent, child); it grows by `add` alone, so that nothing unchecked gets in."""

    @property
    def frames(self) -> tuple[str, ...]:
        """All frames, in the order in which they came in."""
        return tuple(dict.fromkeys(name for edge in self.transforms for name in edge))

    def add(self, parent: str, child: str, T_parent_child: ArrayLike) -> FrameGraph:
        """A graph with one more transform: p_parent = T_parent_child p_child.

        Where the two frames are already connected, the new transform must agree with the known path within the
        tolerances; a second transform between the same two frames then changes nothing.
        Args: T_parent_child (4, 4) or (..., 4, 4), metres.
        Raises: InputError for a matrix that is no rigid transform, a frame relative to itself, a contradiction,
        leading axes that do not fit those in the graph.
        """
        if parent == child:
            raise InputError(f"a frame has no transform to itself: both ends are called {parent!r}")
        T = se3.check(T_parent_child, name=f"T_{parent}_{child}")
        self._check_batch(parent, child, T)
        path = self._path(parent, child)
        if path is not None:
            self._check_agreement(path, T)
        if (parent, child) in self.transforms or (child, parent) in self.transforms:
            return self
        T.setflags(write=False)
        larger = FrameGraph(tolerance_m=self.tolerance_m, tolerance_rad=self.tolerance_rad)
        object.__setattr__(larger, "transforms", MappingProxyType({**self.transforms, (parent, child): T}))
        return larger

    def T(self, parent: str, child: str) -> Array:
        """T_parent_child, the pose of `child` in `parent`, along the path with the fewest transforms: (..., 4, 4).

        Raises: InputError for an unknown frame (the message lists the known ones) and for frames that no chain of
        transforms connects (it lists the groups that are connected).
        """
        return self._compose(self.path(parent, child))

    def path(self, parent: str, child: str) -> tuple[str, ...]:
        """Frames passed on the shortest way from `parent` to `child`, both included. Raises: as `T`."""
        known = self.frames
        for name in (parent, child):
            if name not in known:
                listed = ", ".join(known) if known else "none; add a transform first"
                raise InputError(f"unknown frame {name!r}; known frames: {listed}")
        path = self._path(parent, child)
        if path is None:
            groups = "; ".join("{" + ", ".join(group) + "}" for group in self.groups())
            raise InputError(
                f"no chain of transforms leads from {parent!r} to {child!r}; connected groups: {groups}; "
                "add a transform between two of them"
            )
        return path

    def groups(self) -> tuple[tuple[str, ...], ...]:
        """The frames in groups; within a group every frame is known relative to every other."""
        groups: list[tuple[str, ...]] = []
        for name in self.frames:
            if not any(name in group for group in groups):
                groups.append(tuple(self._reach(name)))
        return tuple(groups)

    def _neighbours(self, name: str) -> list[str]:
        return [b if a == name else a for a, b in self.transforms if name in (a, b)]

    def _reach(self, start: str) -> dict[str, str]:
        """Frames reachable from `start`, nearest first, each with the frame before it (breadth-first)."""
        before = {start: start}
        queue = deque([start])
        while queue:
            here = queue.popleft()
            for name in self._neighbours(here):
                if name not in before:
                    before[name] = here
                    queue.append(name)
        return before

    def _path(self, parent: str, child: str) -> tuple[str, ...] | None:
        before = self._reach(parent)
        if child not in before:
            return None
        path = [child]
        while path[-1] != parent:
            path.append(before[path[-1]])
        return tuple(reversed(path))

    def _compose(self, path: tuple[str, ...]) -> Array:
        T = np.eye(4)
        for a, b in pairwise(path):
            known = self.transforms.get((a, b))
            T = T @ (se3.inverse(self.transforms[b, a]) if known is None else known)
        return T

    def _check_batch(self, parent: str, child: str, T: Array) -> None:
        shapes = [known.shape[:-2] for known in self.transforms.values()]
        try:
            np.broadcast_shapes(T.shape[:-2], *shapes)
        except ValueError as error:
            batch = next(s for s in shapes if s)
            raise InputError(
                f"T_{parent}_{child} holds {T.shape[:-2]} transforms, but the graph holds {batch}; "
                "all moving frames of one graph need the same number of moments"
            ) from error

    def _check_agreement(self, path: tuple[str, ...], T: Array) -> None:
        known = self._compose(path)
        off_m = float(np.max(np.linalg.norm(known[..., :3, 3] - T[..., :3, 3], axis=-1)))
        off_rad = float(np.max(so3.angle(known[..., :3, :3] @ np.swapaxes(T[..., :3, :3], -1, -2))))
        if off_m > self.tolerance_m or off_rad > self.tolerance_rad:
            raise InputError(
                f"T_{path[0]}_{path[-1]} contradicts the known path {' -> '.join(path)}: they differ by "
                f"{1e3 * off_m:.4g} mm and {np.rad2deg(off_rad):.4g} deg (allowed {1e3 * self.tolerance_m:.4g} mm and "
                f"{np.rad2deg(self.tolerance_rad):.4g} deg); check its direction and unit, or leave one of them out"
            )
