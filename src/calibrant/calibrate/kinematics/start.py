"""Starts of kinematic calibration: where base and tool are, for a nominal robot; where the axes are, without one."""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.solvers.registry import SOLVERS
from calibrant.data.joint_measurements import JointMeasurements
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3
from calibrant.robots.chain import Joint
from calibrant.robots.geometry import ParametricChain
from calibrant.robots.poe import ProductOfExponentials

_ROUNDS = 50
"""Alternations between base and tool; each shrinks the error by the ratio of tool to reach, a tenth or so."""
_ALONE = 0.02
"""Other joints may move by this share of the joint itself: the axis is then off by as much, a good start."""
_LARGEST_TURN = 2.8
"""Radians: a rotation vector tells its direction safely below half a turn."""


def base_and_tool(
    chain: ParametricChain, measurements: JointMeasurements, *, hold_base: bool, hold_tool: bool
) -> tuple[Array, Array]:
    """T_world_base and T_flange_tool (4, 4) that fit the measurements best, roughly; the identity where held.

    Poses: FK_i T_flange_tool inverse(T_world_tool_i) = T_base_world, the normal form of hand-eye calibration. Positions
    alone: Procrustes for the base and a linear problem for the tool's point in turn.
    """
    forward = chain.forward(measurements.joints)
    if measurements.rotations is None:
        return _from_positions(forward, measurements.positions, hold_base=hold_base, hold_tool=hold_tool)
    T = se3.make(measurements.rotations, measurements.positions)
    if hold_base and hold_tool:
        return np.eye(4), np.eye(4)
    if hold_base:
        return np.eye(4), se3.mean(se3.inverse(forward) @ T)
    if hold_tool:
        return se3.mean(T @ se3.inverse(forward)), np.eye(4)
    try:
        solution = SOLVERS["shah"].solve(forward, se3.inverse(T))
    except RefusedError:
        # A SCARA turns about one direction alone: how far base and tool are along it is one number, not two, which the
        # choice of parameters sees to; a start is any pair that fits.
        base, point = _from_positions(forward, measurements.positions, hold_base=False, hold_tool=False)
        turn = so3.mean(np.swapaxes(base[:3, :3] @ forward[:, :3, :3], -1, -2) @ measurements.rotations)
        return base, se3.make(turn, point[:3, 3])
    return se3.inverse(solution.Z), solution.X


def _from_positions(forward: Array, p: Array, *, hold_base: bool, hold_tool: bool) -> tuple[Array, Array]:
    if len(p) < 3:
        raise RefusedError(f"{len(p)} measured positions; base and tool need many more, the geometry some forty")
    base: Array = np.eye(4)
    point: Array = np.zeros(3)
    for _ in range(_ROUNDS):
        if not hold_base:
            base = se3.carrying(se3.apply(forward, point), p)
        if not hold_tool:
            # p = R_wb (R_i point + t_i) + t_wb: linear in the point.
            R = base[:3, :3] @ forward[:, :3, :3]
            rest = p - se3.apply(base, forward[:, :3, 3])
            point = np.asarray(np.linalg.lstsq(R.reshape(-1, 3), rest.ravel(), rcond=1e-6)[0], dtype=np.float64)
    return base, se3.make(np.eye(3), point)


def free_chain(measurements: JointMeasurements) -> ProductOfExponentials:
    """A product of exponentials in the measuring frame from poses in which one joint moves at a time.

    Two poses that differ in joint k alone give its screw: T_j T_i^-1 = P exp(S_k dq) P^-1, P the product of the joints
    before it. Raises: RefusedError naming the joint that never moves alone, or whose values are not radians.
    """
    if measurements.rotations is None:
        raise RefusedError(
            "positions alone do not start a robot without a nominal model; give the robot (--robot FILE), or full poses"
        )
    T = se3.make(measurements.rotations, measurements.positions)
    q = measurements.joints
    names = measurements.joint_names or tuple(f"joint_{k + 1}" for k in range(q.shape[1]))
    screws: list[Array] = []
    joints: list[Joint] = []
    for k, name in enumerate(names):
        screw = _screw(T, q, k, name, np.array(screws).reshape(-1, 6))
        turns = np.linalg.norm(screw[:3]) > 0.5  # a turning joint turns by 1 a radian, a sliding one by nothing
        screws.append(screw / np.linalg.norm(screw[:3] if turns else screw[3:]))
        lowest, highest = float(q[:, k].min()), float(q[:, k].max())
        joints.append(Joint(name, lowest, highest, "revolute" if turns else "prismatic"))
    return _chain_of(tuple(joints), np.array(screws), T, q)


def _refuse_coupled(d: Array, k: int, name: str) -> None:
    """Raises: RefusedError where another joint changes by as much as joint k whenever only these two change.

    d (p, joints): differences between poses.
    """
    for m in range(d.shape[1]):
        if m == k:
            continue
        others = np.abs(np.delete(d, [k, m], axis=1)).max(axis=1, initial=0.0)
        pair = (np.abs(d[:, k]) > 1e-3) & (others < _ALONE * np.abs(d[:, k]))
        for sign, words, instead in ((1, "more", "less"), (-1, "less", "plus")):
            if np.any(pair & (np.abs(d[:, m] - sign * d[:, k]) < _ALONE * np.abs(d[:, k]))):
                raise RefusedError(
                    f"joint {name} never moves alone: joint {m + 1} reads as much {words} whenever it does. The two "
                    f"are coupled, as where J3 is told against the ground (Fanuc): give joint {m + 1} {instead} joint "
                    f"{k + 1} in its place, or the robot (--robot FILE) and --identify offsets,coupling,geometry"
                )


def _screw(T: Array, q: Array, k: int, name: str, before: Array) -> Array:
    """Twist per unit of joint k, weighted mean over all pairs in which it moves alone."""
    i, j = np.triu_indices(len(q), 1)
    d = every = q[j] - q[i]
    others = np.abs(np.delete(d, k, axis=1)).max(axis=1, initial=0.0)
    single = (np.abs(d[:, k]) > 1e-3) & (others < _ALONE * np.abs(d[:, k]))
    alone = single & (np.abs(d[:, k]) < _LARGEST_TURN)
    if single.any() and not alone.any():
        raise RefusedError(
            f"joint {name} moves alone by {np.abs(d[single, k]).min():.3g} and more, never by less than half a turn; "
            "if the joints are given in degrees, say so: --joint-angle deg"
        )
    if not alone.any():
        _refuse_coupled(d, k, name)
        raise RefusedError(
            f"joint {name} never moves alone; without a nominal robot every joint needs poses between which only it "
            "moves (by less than half a turn); add such poses, or give the robot (--robot FILE)"
        )
    i, j, step = i[alone], j[alone], d[alone, k]
    P = _screw_product(before, q[i])
    twists = se3.log(se3.inverse(P) @ T[j] @ se3.inverse(T[i]) @ P)
    screw = (step @ twists) / (step @ step)
    rate = float(np.linalg.norm(screw[:3]))
    slides = rate < 0.02 and np.linalg.norm(screw[3:]) > 0.5
    if not slides and not 0.8 < rate < 1.25:
        _refuse_coupled(every, k, name)
        degrees = abs(rate * 180 / np.pi - 1) < 0.25
        cure = (
            "; if it is given in degrees, say so: --joint-angle deg"
            if degrees
            else "; check its unit (radians) and gear"
        )
        raise RefusedError(f"joint {name} turns the tool by {rate:.3g} rad for each unit it reads{cure}")
    return screw


def _screw_product(screws: Array, q: Array) -> Array:
    P = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for k, screw in enumerate(screws):
        P = P @ se3.exp(q[:, k : k + 1] * screw)
    return P


def _chain_of(joints: tuple[Joint, ...], screws: Array, T: Array, q: Array) -> ProductOfExponentials:
    """The chain with the point of each axis that lies closest to the middle of the measured positions."""
    home = se3.mean(se3.inverse(_screw_product(screws, q)) @ T)
    middle = T[:, :3, 3].mean(axis=0)
    omega, v = screws[:, :3], screws[:, 3:]
    turns = np.array([j.kind == "revolute" for j in joints])[:, None]
    foot = np.cross(omega, v)
    points = foot + ((middle - foot) * omega).sum(axis=1, keepdims=True) * omega
    directions = np.where(turns, omega, v)
    return ProductOfExponentials(joints, directions, np.where(turns, points, middle), home)
