"""Poses with the moments they were taken at: any file that poses are read from, with a column of times."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.formats.poses.joint_columns import poses_from_joints
from calibrant.formats.poses.makers import merged, refuse_other_units, robot_format
from calibrant.formats.poses.notations import PoseNotation, notations, options
from calibrant.formats.poses.read import read_table, refuse_ambiguous
from calibrant.formats.poses.rows import PoseTable, raw_poses
from calibrant.formats.poses.time_column import in_seconds, split_times, without_times
from calibrant.reading.notes import note_unused
from calibrant.robots.chain import KinematicChain


@dataclass(frozen=True, eq=False)
class TimedPoses:
    """times (n,), seconds, and T (n, 4, 4), metres; description: how the poses were read."""

    times: Array
    T: Array
    description: str


def read_timed_poses(
    paths: str | Path | Iterable[str | Path],
    *,
    robot: KinematicChain | None = None,
    joint_angle: str = "auto",
    maker: str | None = None,
    units: str = "auto",
    rotation: str = "auto",
    angle: str = "auto",
    direction: str = "auto",
) -> TimedPoses:
    """Poses and times of a file. Options as for `read_poses`.

    Raises: InputError naming the file: no times, times that are no numbers, poses that can be read in several ways.
    """
    asked = options(units=units, rotation=rotation, angle=angle, direction=direction)
    fmt = None if maker is None else robot_format(maker)
    table, _ = read_table(paths, fmt)
    times, table = _times(table)
    if robot is not None:
        raw = poses_from_joints(table, robot, angle=joint_angle)
    else:
        raw = raw_poses(table)
        if fmt is not None:
            refuse_other_units(raw, fmt, asked)
            asked = merged(asked, fmt)
        raw = replace(raw, options=asked)
        refuse_ambiguous(raw)
    note_unused(raw.source, without_times(raw.unused))
    notation: PoseNotation = notations(raw)[0]
    repeated = _repeated(times, notation.T_base_gripper)
    note = f"; {int(repeated.sum())} samples that repeat the one before are left out" if repeated.any() else ""
    T = notation.T_base_gripper[~repeated]
    return TimedPoses(times[~repeated], T, f"{table.source}: {notation.description}{note}")


def _repeated(times: Array, T: Array) -> NDArray[np.bool_]:
    """Samples (n,) that say again what the one before said, as recorders write that poll faster than poses come."""
    same = (np.diff(times) == 0) & np.all(T[1:] == T[:-1], axis=(1, 2))
    return np.concatenate([[False], same])


def _times(table: PoseTable) -> tuple[Array, PoseTable]:
    """Times in seconds, and the table without them."""
    found = split_times(table)
    if found is not None:
        return found
    if table.names is not None:
        try:
            values = np.array([float(name) for name in table.names])
        except ValueError:
            values = np.zeros(0)
        if len(values):
            return in_seconds(values), replace(table, names=None)
    raise InputError(
        f"{table.source}: no times; expected a column 'timestamp' (seconds, or timestamp[ms], [us], [ns]); found "
        f"{', '.join(repr(c.strip()) for c in table.header)}"
    )
