"""Robot poses: T_base_gripper by name."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.expected import names_of
from calibrant.geometry import se3


@dataclass(frozen=True, eq=False)
class RobotPoses:
    """Poses of the gripper (flange, wrist, tool) in the robot's base, metres.

    ids (n,) name the moments (image names, when the file gives them); T_base_gripper (n, 4, 4).
    `source` says how the file was read, for people.

        >>> import calibrant as cb, numpy as np
        >>> cb.RobotPoses(("0.png", "1.png"), np.stack([np.eye(4)] * 2)).ids
        ('0.png', '1.png')
    """

    ids: tuple[str, ...]
    T_base_gripper: Array
    source: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "ids", names_of(self.ids, "ids", "the names of the poses"))
        T = se3.check(self.T_base_gripper, name="T_base_gripper")
        if T.shape != (len(self.ids), 4, 4):
            raise InputError(f"{len(self.ids)} pose names but poses of shape {T.shape}; expected (n, 4, 4)")
        repeated = sorted({i for i in self.ids if self.ids.count(i) > 1}) if len(set(self.ids)) < len(self.ids) else []
        if repeated:
            raise InputError(f"pose names occur twice: {', '.join(repeated[:5])}; every pose needs its own name")
        T.setflags(write=False)
        object.__setattr__(self, "T_base_gripper", T)

    @classmethod
    def from_matrices(cls, T_base_gripper: ArrayLike, *, ids: Iterable[str] | None = None) -> RobotPoses:
        """Poses from an (n, 4, 4) array, metres, named "0", "1", … unless `ids` says otherwise."""
        T = se3.check(T_base_gripper, name="T_base_gripper")
        return cls(tuple(str(i) for i in range(len(T))) if ids is None else tuple(str(i) for i in ids), T)

    def __len__(self) -> int:
        return len(self.ids)

    def __repr__(self) -> str:
        source = f", {self.source}" if self.source else ""
        return f"RobotPoses({len(self)} poses{source})"

    def only(self, ids: Iterable[str]) -> RobotPoses:
        """The poses of these ids, in the order asked. Raises: InputError naming an id that is not there."""
        index = {name: i for i, name in enumerate(self.ids)}
        wanted = list(ids)
        unknown = [i for i in wanted if i not in index]
        if unknown:
            raise InputError(f"no robot pose called {unknown[0]!r}; known: {', '.join(self.ids[:8])} …")
        return RobotPoses(tuple(wanted), self.T_base_gripper[[index[i] for i in wanted]], self.source)
