"""Joint values of a bag as the motion of a robot: sensor_msgs/JointState by the joints' names, through its chain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.formats.bags.bag import JOINTS, Bag
from calibrant.formats.bags.stamps import HEADER, seconds_of
from calibrant.robots.chain import KinematicChain


@dataclass(frozen=True, eq=False)
class JointMotion:
    """times (n,), seconds, increasing; q (n, k), radians and metres, in the order of the chain's joints."""

    times: Array
    q: Array

    def at(self, t: Array) -> Array:
        """q (m, k) at times (m,), straight between samples."""
        return np.column_stack([np.interp(t, self.times, column) for column in self.q.T])


def read_joints(bag: Bag, chain: KinematicChain, topic: str | None = None, *, stamps: str = HEADER) -> JointMotion:
    """The robot's joints over time. topic: where several have joint values.

    Raises: InputError for a topic that is not there, values without the chain's joints (those that are there are
    named), or a clock that jumps.
    """
    topics = bag.of_kind(JOINTS)
    if not topics or (topic is not None and topic not in topics):
        listed = ", ".join(topics) or "none"
        asked = f"no joint values under {topic}" if topic else "no joint values (sensor_msgs JointState)"
        raise InputError(f"bag {bag.path} has {asked}; topics that have some: {listed}")
    wanted = [joint.name for joint in chain.joints]
    stamped: list[int | None] = []
    received: list[int] = []
    rows: list[list[float]] = []
    others: dict[str, None] = {}
    for message in bag.messages([topic] if topic else topics):
        state = bag.read(message)
        values = dict(zip(map(str, state.name), map(float, state.position)))
        if not all(name in values for name in wanted):
            others |= dict.fromkeys(values)
            continue
        stamped.append(message.stamp_ns)
        received.append(message.received_ns)
        rows.append([values[name] for name in wanted])
    if not rows:
        raise InputError(
            f"bag {bag.path}: no message has values of all joints of --robot, {', '.join(wanted)}; it has "
            f"{', '.join(others) or 'none'}. Is it this robot's, and are --robot-base and --robot-link its ends?"
        )
    q = np.array(rows, float)
    if not np.isfinite(q).all():
        raise InputError(f"bag {bag.path}: joint values are NaN or infinite")
    times = seconds_of(stamped, received, what="the joint values", stamps=stamps)
    times, first = np.unique(times, return_index=True)
    return JointMotion(times, q[first])
