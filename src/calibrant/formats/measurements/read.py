"""Measurements for kinematic calibration: joint values and the measured pose or position, in one table.

Any file that poses are read from will do, with joints beside the pose: columns q1 … qn, or the joints' names, or a list
under `joints`. Without a rotation the positions stand alone, as a laser tracker gives them; three
points or more a pose, on one body, are its pose.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.data.joint_measurements import JointMeasurements
from calibrant.errors import InputError
from calibrant.formats.measurements.tool_points import ToolPoints, body_of, tool_points
from calibrant.formats.poses.columns import (
    LENGTH_UNITS,
    has_rotation,
    position_columns,
    unused_beside_position,
)
from calibrant.formats.poses.joint_columns import (
    JointColumns,
    joint_values,
    joints_in,
    names_of,
    without,
)
from calibrant.formats.poses.makers import merged, refuse_other_units, robot_format
from calibrant.formats.poses.notations import notations, options
from calibrant.formats.poses.raw import PoseOptions
from calibrant.formats.poses.read import read_table, refuse_ambiguous
from calibrant.formats.poses.rows import PoseTable, numbers_of, raw_poses
from calibrant.formats.poses.time_column import without_times
from calibrant.reading.notes import note, note_unused
from calibrant.robots.chain import KinematicChain

_FARTHEST_M = 50.0
"""A tool is measured within this distance; numbers beyond it are millimetres."""


def read_measurements(
    paths: str | Path | Iterable[str | Path],
    *,
    robot: KinematicChain | None = None,
    units: str = "auto",
    rotation: str = "auto",
    angle: str = "auto",
    direction: str = "auto",
    joint_angle: str = "auto",
    maker: str | None = None,
) -> JointMeasurements:
    """Joint values and measured tool poses (T_world_tool) or positions of one file, or one file a measurement.

    Args: robot, whose joints the columns are; without it they are numbered ones. Options as for `read_poses`.
    Raises: InputError naming the file: no joints, unknown ones, limits passed, poses that can be read in several ways.
    """
    asked = options(units=units, rotation=rotation, angle=angle, direction=direction)
    table, _ = read_table(paths)
    columns = _joints(table, robot)
    q, words = joint_values(table, columns, robot, angle=joint_angle)
    names = tuple(j.name for j in robot.joints) if robot is not None else columns.names
    rest = without(table, columns)
    ids = names_of(table) or tuple(str(i) for i in range(len(table.rows)))
    several = tool_points(rest, q, None if asked.units == "auto" else asked.units)
    if several is not None:
        return _of_points(several, ids, q, names, f"{table.source}: {words}")
    if has_rotation(rest.header):
        raw = raw_poses(rest)
        if maker is not None:
            refuse_other_units(raw, robot_format(maker), asked)
            asked = merged(asked, robot_format(maker))
        raw = replace(raw, options=asked)
        refuse_ambiguous(raw)
        note_unused(raw.source, without_times(raw.unused))
        notation = notations(raw)[0]
        T = notation.T_base_gripper
        source = f"{table.source}: {words}; {notation.description}"
        return JointMeasurements(ids, q, T[:, :3, 3], T[:, :3, :3], names, source)
    positions, unit = _positions(rest, asked if maker is None else merged(asked, robot_format(maker)))
    note_unused(table.source, without_times(unused_beside_position(rest.header)))
    source = f"{table.source}: {words}; positions in {unit}"
    return JointMeasurements(ids, q, positions * LENGTH_UNITS[unit], None, names, source)


def _of_points(
    several: ToolPoints, ids: Sequence[str], q: Array, names: tuple[str, ...], source: str
) -> JointMeasurements:
    """Poses of the tool from its points; a pose with fewer than 3 is left out, and said."""
    body = body_of(several, source)
    seen = np.flatnonzero(np.isfinite(body.T[:, 0, 0]))
    if len(seen) < len(body.T):
        lost = [ids[several.rows[i]] for i in range(len(body.T)) if i not in set(seen.tolist())]
        note(f"{source}: left out, fewer than 3 points seen: {', '.join(lost[:5])}{' …' if len(lost) > 5 else ''}")
    rows, T = several.rows[seen], body.T[seen]
    said = f"{source}; {len(several.labels)} points a pose, on one body to {body.rms * 1e3:.2g} mm rms"
    return JointMeasurements(tuple(ids[i] for i in rows), q[rows], T[:, :3, 3], T[:, :3, :3], names, said)


def _joints(table: PoseTable, robot: KinematicChain | None) -> JointColumns:
    found = joints_in(table, robot)
    if found is None:
        raise InputError(
            f"{table.source}: no joint values; expected columns q1, q2 … or a list under 'joints' beside the measured "
            f"pose; found {', '.join(repr(c.strip()) for c in table.header)}"
        )
    return found


def _positions(table: PoseTable, asked: PoseOptions) -> tuple[NDArray[np.float64], str]:
    try:
        columns, stated = position_columns(table.header)
    except InputError as error:
        raise InputError(f"{table.source}: {error}") from error
    positions = numbers_of(table, columns)
    if asked.units != "auto":
        return positions, asked.units
    if stated is not None:
        return positions, stated
    return positions, "m" if abs(positions).max() <= _FARTHEST_M else "mm"
