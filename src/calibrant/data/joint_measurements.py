"""What kinematic calibration works on: joint values, and where the tool was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError


@dataclass(frozen=True, eq=False)
class JointMeasurements:
    """ids (n,); joints (n, k), radians or metres; positions (n, 3) of the tool in the measuring frame, metres.

    rotations (n, 3, 3) of the tool, or None when only positions were measured. joint_names (k,): as the file has them.
    Raises: InputError for shapes that do not fit, or values that are not finite.
    """

    ids: tuple[str, ...]
    joints: Array
    positions: Array
    rotations: Array | None = None
    joint_names: tuple[str, ...] = ()
    source: str = ""

    def __post_init__(self) -> None:
        n, joints, positions = len(self.ids), np.asarray(self.joints), np.asarray(self.positions)
        if n == 0 or joints.ndim != 2 or len(joints) != n or positions.shape != (n, 3):
            raise InputError(
                f"{n} measurements with joints of shape {joints.shape} and positions of shape {positions.shape}; "
                "expected (n, joints) and (n, 3)"
            )
        if self.rotations is not None and np.shape(self.rotations) != (n, 3, 3):
            raise InputError(f"{n} measurements with rotations of shape {np.shape(self.rotations)}; expected (n, 3, 3)")
        for i, name in enumerate(self.ids):
            rotation = np.zeros(0) if self.rotations is None else self.rotations[i]
            if not all(np.all(np.isfinite(a)) for a in (joints[i], positions[i], rotation)):
                raise InputError(f"measurement {name}: NaN or infinity; leave it out")

    def __len__(self) -> int:
        return len(self.ids)

    def take(self, rows: Sequence[int] | NDArray[np.int64]) -> JointMeasurements:
        """Some of the measurements, in the order of `rows`."""
        index = np.asarray(rows, dtype=np.int64)
        rotations = None if self.rotations is None else self.rotations[index]
        ids = tuple(self.ids[i] for i in index.tolist())
        return JointMeasurements(
            ids, self.joints[index], self.positions[index], rotations, self.joint_names, self.source
        )
