"""Poses with the moments they were taken at: any file that poses are read from, with a column of times."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrant.errors import InputError
from calibrant.formats.joint_columns import poses_from_joints
from calibrant.formats.pose_columns import name_and_unit
from calibrant.formats.pose_readings import PoseReading, options, readings
from calibrant.formats.pose_rows import PoseTable, numbers_of, raw_poses
from calibrant.formats.poses import read_table, refuse_ambiguous
from calibrant.formats.robot_formats import merged, robot_format
from calibrant.robots.chain import KinematicChain

Array = NDArray[np.float64]

_TIME = re.compile(r"^(?:header)?(?:timestamp|time|stamp|t|secs?|seconds)(?P<unit>s|ms|us|ns)?$")
_SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
_UNIX = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))
"""Times since 1970 are 1.8e9 s: numbers of these sizes can only be finer units of them."""


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
        raw = replace(raw_poses(table), options=asked if fmt is None else merged(asked, fmt))
        refuse_ambiguous(raw)
    reading: PoseReading = readings(raw)[0]
    return TimedPoses(times, reading.T_base_gripper, f"{table.source}: {reading.description}")


def _times(table: PoseTable) -> tuple[Array, PoseTable]:
    """Times in seconds, and the table without them."""
    for i, column in enumerate(table.header):
        name, unit = name_and_unit(column)
        match = _TIME.match(name)
        if match is None:
            continue
        values = numbers_of(table, (i,), bounded=False)[:, 0]
        unit = unit or match["unit"] or _finer(values)
        if unit not in _SECONDS:
            raise InputError(f"{table.source}: the unit {unit!r} of times is not known here; known: s, ms, us, ns")
        rest = tuple(row[:i] + row[i + 1 :] for row in table.rows)
        return values * _SECONDS[unit], replace(table, header=table.header[:i] + table.header[i + 1 :], rows=rest)
    if table.names is not None:
        try:
            values = np.array([float(name) for name in table.names])
        except ValueError:
            values = np.zeros(0)
        if len(values):
            return values * _SECONDS[_finer(values)], replace(table, names=None)
    raise InputError(
        f"{table.source}: no times; expected a column 'timestamp' (seconds, or timestamp[ms], [us], [ns]); found "
        f"{', '.join(repr(c.strip()) for c in table.header)}"
    )


def _finer(values: Array) -> str:
    largest = float(np.abs(values).max())
    return next((unit for bound, unit in _UNIX if largest > bound), "s")
