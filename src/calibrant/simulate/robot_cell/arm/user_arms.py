"""Arms of the user's own: any MJCF or URDF, with its meshes; and the meshes of packages that are installed.

The longest chain of joints is the arm. What moves beyond it (a hand of its own) is left out, as the cell's gripper is
put on the flange: the site or the body at the chain's end.
"""

from __future__ import annotations

from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.robots.chain import Joint
from calibrant.robots.geometry import frame_about
from calibrant.robots.links import LinkChain, Mover
from calibrant.simulate.robot_cell.arm.arms import CellArm
from calibrant.simulate.robot_cell.arm.servos import add_servo
from calibrant.simulate.robot_cell.world.engine import need_mujoco, pose_of

if TYPE_CHECKING:
    import mujoco

PACKAGED = {"panda-mesh": ("dm-robotics-panda", "assets/panda/panda.xml")}
"""Arms whose files come with a package: its name, and how the file's path ends. It is found by that, not imported."""
_PREFIX = "arm/"
_SPEED = 1.5
"""rad/s (m/s) of joints whose file gives none: a slow industrial arm's."""


def packaged_file(name: str) -> str:
    """The file of an arm that a package brings. Raises: InputError naming the package to install."""
    package, end = PACKAGED[name]
    try:
        files = metadata.files(package) or []
    except metadata.PackageNotFoundError:
        files = []
    for file in files:
        if file.as_posix().endswith(end):
            return str(file.locate())
    raise InputError(f"the arm {name} needs the package {package}, by file alone: pip install --no-deps {package}")


def file_arm(path: str) -> CellArm:
    """The arm of an MJCF or URDF file. Raises: InputError for a file that is none, or has no arm of 6 or 7 joints."""
    model = _loaded(path).compile()
    mujoco = need_mujoco()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    joints = _longest_chain(model, path)
    # Joints at 0, wherever the file starts: a chain's links are those at 0.
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(model, data)
    frames, movers, of_chain = [np.eye(4)], [], []
    for j in joints:
        name = model.joint(j).name
        turns = model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE
        kind: Any = "revolute" if turns else "prismatic"
        frames.append(se3.make(frame_about(data.xaxis[j]), data.xanchor[j]))
        movers.append(Mover(name, kind=kind))
        low, high = model.jnt_range[j] if model.jnt_limited[j] else (-np.pi, np.pi)
        of_chain.append(Joint(name, float(low), float(high), kind))
    frames.append(_flange(model, data, joints[-1]))
    stacked = np.array(frames)
    chain = LinkChain(tuple(of_chain), tuple(movers), se3.inverse(stacked[:-1]) @ stacked[1:])
    return CellArm(
        Path(path).stem, chain, _home(model, chain, joints), np.full(len(joints), _SPEED), np.array([]), path
    )


def add_file_arm(world: mujoco.MjSpec, arm: CellArm) -> mujoco.MjsBody:
    """The file's bodies in the cell, with servos on the chain's joints; returns the flange's body."""
    mujoco = need_mujoco()
    spec = _loaded(str(arm.file))
    for kind in (spec.actuators, spec.sensors, spec.keys, spec.equalities):
        for element in list(kind):
            spec.delete(element)
    names = [j.name for j in arm.chain.joints]
    for joint in list(spec.joints):
        if joint.name not in names:
            spec.delete(joint.parent)
    for geom in spec.geoms:
        if geom.contype or geom.conaffinity:
            geom.contype, geom.conaffinity = 2, 0
    for body in spec.bodies:
        body.gravcomp = 1.0
    world.attach(spec, prefix=_PREFIX, frame=world.worldbody.add_frame())
    for name in names:
        joint = world.joint(_PREFIX + name)
        joint.armature = max(float(np.max(joint.armature)), 0.1)
        add_servo(world, _PREFIX + name, name)
    last = world.joint(_PREFIX + names[-1]).parent
    model = world.copy().compile()
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(model, data)
    at = model.body(last.name).id
    F = se3.inverse(pose_of(data.xpos[at], data.xquat[at])) @ arm.chain.forward(np.zeros(len(names)))
    return last.add_body(name="flange", pos=F[:3, 3], quat=so3.quaternion_wxyz(F[:3, :3]), gravcomp=1.0)


def _loaded(path: str) -> mujoco.MjSpec:
    mujoco = need_mujoco()
    if not Path(path).is_file():
        raise InputError(f"there is no arm and no file called {path}; arms by name: panda, ur5e, ur3e, ur10e")
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise InputError(f"{path} is no robot that MuJoCo reads (MJCF, URDF): {error}") from error


def _longest_chain(model: mujoco.MjModel, path: str) -> list[int]:
    """Hinges and slides from the base to the body with most of them before it; slides at its end are fingers."""
    mujoco = need_mujoco()
    best: list[int] = []
    for body in range(model.nbody):
        chain: list[int] = []
        b = body
        while b > 0:
            first, count = int(model.body_jntadr[b]), int(model.body_jntnum[b])
            chain = [*range(first, first + count), *chain] if count else chain
            b = int(model.body_parentid[b])
        while chain and model.jnt_type[chain[-1]] == mujoco.mjtJoint.mjJNT_SLIDE:
            chain.pop()
        if len(chain) > len(best):
            best = chain
    if len(best) not in (6, 7):
        raise InputError(f"{path} has a chain of {len(best)} joints; the cell takes arms of 6 or 7")
    return best


def _flange(model: mujoco.MjModel, data: mujoco.MjData, last_joint: int) -> Array:
    """The end of what the last joint carries: a fixed body at its end, a site there, else the body itself."""
    body = int(model.jnt_bodyid[last_joint])
    for name in ("flange", "attachment_site", "tool0", "ee"):
        for site in range(model.nsite):
            if model.site(site).name.endswith(name) and int(model.site_bodyid[site]) >= body:
                T = np.eye(4)
                T[:3, :3], T[:3, 3] = data.site_xmat[site].reshape(3, 3), data.site_xpos[site]
                return T
    while True:
        fixed = [b for b in range(model.nbody) if model.body_parentid[b] == body and b > 0 and not model.body_jntnum[b]]
        if len(fixed) != 1:
            return pose_of(data.xpos[body], data.xquat[body])
        body = fixed[0]


def _home(model: mujoco.MjModel, chain: LinkChain, joints: list[int]) -> Array:
    """The file's first key, else the middle of the joints' ranges, where a joint without limits is at 0."""
    if model.nkey:
        return np.array([model.key_qpos[0][model.jnt_qposadr[j]] for j in joints])
    return 0.5 * (chain.lower + chain.upper)
