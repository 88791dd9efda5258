"""Poses in a result of calibrant: of a target, as `calibrant pose` writes them, or of a robot, as a hand-eye result."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrant.data.result_file import read_result
from calibrant.errors import InputError
from calibrant.formats.poses.raw import Stated
from calibrant.formats.poses.rows import MATRIX_NAMES, PoseTable

_AS_WRITTEN = Stated(units="m", rotation="matrix", direction="base-gripper")


def poses_of_result(path: Path) -> tuple[PoseTable, PoseTable | None]:
    """The table of a result's poses: T_camera_target of its views where it found these, else its robot poses.

    Both where it holds a robot's poses and the target's that were given with them.
    Raises: InputError for a result of another kind, or as `read_result`.
    """
    result = read_result(path)
    poses = result.robot_poses
    if poses is not None:
        given = result.T_camera_target
        robot = _result_table(poses.ids, poses.T_base_gripper, path)
        return robot, None if given is None else _result_table(poses.ids, given, path)
    seen = [(v.id, v.T_camera_target) for v in result.views if v.used and v.T_camera_target is not None]
    if not seen:
        raise InputError(
            f"{path}: the {result.kind} result holds no poses; expected poses, or the result of calibrant pose"
        )
    return _result_table([name for name, _ in seen], np.array([T for _, T in seen]), path), None


def _result_table(ids: Sequence[str], T: NDArray, path: Path) -> PoseTable:
    rows = tuple(tuple(row) for row in T.reshape(-1, 16).tolist())
    places = tuple(f"{path}[{name}]" for name in ids)
    return PoseTable(MATRIX_NAMES, rows, places, str(path), names=tuple(ids), stated=_AS_WRITTEN, keyed=True)
