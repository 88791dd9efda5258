"""The arms of the cell: their published kinematics, where they rest, how fast their joints are, how they look."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from calibrant.arrays import Array
from calibrant.geometry import se3, so3
from calibrant.robots.arms import arm
from calibrant.robots.geometry import frame_about
from calibrant.robots.links import LinkChain, as_links
from calibrant.simulate.robot_cell.arm.servos import add_servo
from calibrant.simulate.robot_cell.parts.noise import RobotNoise

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, eq=False)
class CellArm:
    """An arm: its chain as the controller knows it, its rest joints (n,), its joints' largest speeds (n,), rad/s.

    radii: of its links, metres, from the base to the flange. file: of its own shapes, where it has one.
    """

    name: str
    chain: LinkChain
    home: Array
    speeds: Array
    radii: Array
    file: str | None = None

    def built(self, noise: RobotNoise, rng: np.random.Generator) -> tuple[CellArm, LinkChain]:
        """The arm as its controller knows it, and the chain as it was built: links and encoder zeros off by the noise.

        The shapes of a file are what was built; its controller's figures are then the ones that are off.
        """
        off = self.true_chain(noise, rng)
        return (self, off) if self.file is None else (replace(self, chain=off), self.chain)

    def true_chain(self, noise: RobotNoise, rng: np.random.Generator) -> LinkChain:
        """The chain with its links and encoder zeros off by the noise."""
        lengths = 1e-3 * noise.link_mm
        scale = np.tile(np.repeat([lengths / 0.3, lengths], 3), len(self.chain.movers) + 1)
        built = self.chain.moved(scale * rng.standard_normal(len(scale)))
        return built.with_joint_offsets(
            np.deg2rad(noise.joint_offset_deg) * rng.standard_normal(len(self.chain.joints))
        )


_PANDA_SPEEDS = np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])
_UR_HOME = np.deg2rad([180.0, -100.0, 110.0, -100.0, -90.0, 0.0])
"""Its zero points along -x: half a turn of the base brings it over the table."""


def named_arm(name: str) -> CellArm:
    """The arm of that name. Raises: InputError listing the known ones.

    Speeds: Franka Control Interface's limits; 180 degrees a second for Universal Robots' (data sheets).
    """
    chain = as_links(arm(name))
    if name == "panda":
        home = np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, 0.0])
        return CellArm(name, chain, home, _PANDA_SPEEDS, np.array([0.06, 0.06, 0.055, 0.055, 0.05, 0.05, 0.045, 0.04]))
    return CellArm(name, chain, _UR_HOME, np.full(6, np.pi), np.array([0.06, 0.055, 0.05, 0.045, 0.04, 0.04, 0.035]))


_SHELL = (0.88, 0.88, 0.90, 1.0)
_JOINT = (0.30, 0.33, 0.38, 1.0)
_ARMATURE = 0.3
"""kg m^2 of rotors behind their gears; it dominates the inertia of the wrist's joints, as in real arms."""


def add_arm(world: mujoco.MjSpec, cell_arm: CellArm, true: LinkChain) -> mujoco.MjsBody:
    """The arm as bodies with capsules along its links and a drum at every joint, its servos; returns the flange's body.

    Joints are called as the chain's; a body's frame is that of its joint, so that MuJoCo's flange is `true.forward`.
    """
    import mujoco

    body = world.worldbody
    _add_link(body, true.links[0][:3, 3], cell_arm.radii[0], _STANDS)
    for k, mover in enumerate(true.movers):
        F = true.links[k]
        body = body.add_body(name=f"arm {mover.name}", pos=F[:3, 3], quat=so3.quaternion_wxyz(F[:3, :3]), gravcomp=1.0)
        joint = cell_arm.chain.joints[k]
        turns = mover.kind == "revolute"
        body.add_joint(
            name=joint.name,
            type=mujoco.mjtJoint.mjJNT_HINGE if turns else mujoco.mjtJoint.mjJNT_SLIDE,
            axis=mover.axis,
            armature=_ARMATURE,
            damping=np.array([1.0, 0.0, 0.0]),
        )
        add_servo(world, joint.name, joint.name)
        axis = se3.make(frame_about(np.array(mover.axis)), np.zeros(3))
        radius = cell_arm.radii[k + 1] if k + 1 < len(cell_arm.radii) else cell_arm.radii[-1]
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            size=[1.12 * radius, 1.15 * radius, 0.0],
            quat=so3.quaternion_wxyz(axis[:3, :3]),
            rgba=_JOINT,
            **(ARM_CONTACT if k else _STANDS),
        )
        _add_link(body, true.links[k + 1][:3, 3], radius, ARM_CONTACT if k else _STANDS)
    F = true.links[-1]
    return body.add_body(name="flange", pos=F[:3, 3], quat=so3.quaternion_wxyz(F[:3, :3]), gravcomp=1.0)


ARM_CONTACT: dict[str, Any] = {"contype": 2, "conaffinity": 0, "density": 600.0}
"""The arm touches the table and the things on it (their conaffinity holds bit 2), not itself."""
_STANDS = ARM_CONTACT | {"contype": 0}
"""The first joint stands on the table."""


def _add_link(body: mujoco.MjsBody, end: Array, radius: float, contact: dict[str, Any]) -> None:
    """A capsule from a body's origin to the next joint, or nothing where both coincide."""
    import mujoco

    if np.linalg.norm(end) < radius:
        return
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        size=[radius, 0.0, 0.0],
        fromto=np.concatenate([np.zeros(3), end]),
        rgba=_SHELL,
        **contact,
    )
