"""The cell as a MuJoCo model: room, table, belt, things, arm, gripper; built once, by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibrant.arrays import Array
from calibrant.robots.links import LinkChain
from calibrant.simulate.robot_cell.arm.arms import CellArm, add_arm
from calibrant.simulate.robot_cell.arm.gripper import add_gripper, add_tools
from calibrant.simulate.robot_cell.arm.user_arms import add_file_arm
from calibrant.simulate.robot_cell.parts.spec import COLOURS, CellObject, Conveyor, RobotCellSpec
from calibrant.simulate.robot_cell.world.engine import need_mujoco
from calibrant.simulate.robot_cell.world.light import Light
from calibrant.targets.registry import parse_target

if TYPE_CHECKING:
    import mujoco

SHEET_M = 0.0015
"""Thickness of boards and markers: it stands on the table, its face this much above."""
TABLE_COLOUR = (0.60, 0.58, 0.55, 1.0)
_FLOOR_Z = -0.75
"""Of the room: a table's height below the table."""
_BELT_LENGTH = 3.0
_STEP_S = 0.002


def build_world(spec: RobotCellSpec, arm: CellArm, true: LinkChain, light: Light) -> mujoco.MjModel:
    """The compiled model; bodies are called as the spec's things, "flange", "belt"."""
    mujoco = need_mujoco()
    world = mujoco.MjSpec()
    world.option.timestep = _STEP_S
    world.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    # Elliptic cones and a high ratio of friction's stiffness: without them a held cube creeps out of the fingers.
    world.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    world.option.impratio = 10.0
    world.visual.quality.offsamples = max(c.samples for c in spec.cameras) if _sampled(spec) else 0
    world.visual.quality.shadowsize = 2048 if spec.shadows else 0
    world.visual.headlight.active = 0
    world.visual.global_.offwidth, world.visual.global_.offheight = 8, 8
    lamp = world.worldbody.add_light(pos=[0, 0, 3], dir=light.direction, castshadow=spec.shadows)
    lamp.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    lamp.ambient, lamp.diffuse, lamp.specular = np.full(3, light.ambient), np.full(3, light.diffuse), np.zeros(3)
    _add_room(world)
    if spec.conveyor is not None:
        _add_belt(world, spec.conveyor)
    flange = add_arm(world, arm, true) if arm.file is None else add_file_arm(world, arm)
    add_gripper(world, flange)
    add_tools(flange, parse_target(spec.stick_board), spec.stick_m)
    for k, item in enumerate(spec.objects):
        _add_object(world, item, np.array([6.0 + k, 0.0, 0.0]))
    return world.compile()


def _sampled(spec: RobotCellSpec) -> bool:
    return bool(spec.cameras) and max(c.samples for c in spec.cameras) > 1


def _add_room(world: mujoco.MjSpec) -> None:
    import mujoco

    box = mujoco.mjtGeom.mjGEOM_BOX
    still = world.worldbody
    still.add_geom(name="table", type=box, pos=[0.45, 0, -0.02], size=[0.65, 0.75, 0.02], rgba=TABLE_COLOUR, **_SOLID)
    still.add_geom(
        name="floor", type=box, pos=[0, 0, _FLOOR_Z - 0.05], size=[4, 4, 0.05], rgba=(0.35, 0.36, 0.38, 1), **_SOLID
    )
    wall, seen = (0.72, 0.73, 0.74, 1.0), {"contype": 0, "conaffinity": 0}
    for x, y in ((-2.0, 0.0), (4.0, 0.0), (0.0, -3.0), (0.0, 3.0)):
        size = [0.02, 4, 2] if x else [4, 0.02, 2]
        still.add_geom(type=box, pos=[x, y, 1.25], size=size, rgba=wall, **seen)
    for x in (-0.12, 1.02):
        for y in (-0.68, 0.68):
            still.add_geom(type=box, pos=[x, y, -0.395], size=[0.03, 0.03, 0.355], rgba=(0.3, 0.3, 0.3, 1), **seen)


_SOLID = {"contype": 1, "conaffinity": 3, "friction": [0.8, 0.01, 0.001]}


def _add_belt(world: mujoco.MjSpec, belt: Conveyor) -> None:
    import mujoco

    body = world.worldbody.add_body(name="belt", pos=[belt.x_m, 0, belt.height_m / 2], gravcomp=1.0)
    body.add_joint(name="belt", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 1, 0], armature=1000.0)
    # The belt's weight makes it run on whatever is pressed on it; it is set back by whole steps that nobody sees.
    body.add_geom(
        name="belt",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[belt.width_m / 2, _BELT_LENGTH / 2, belt.height_m / 2],
        rgba=(0.22, 0.23, 0.25, 1.0),
        **(_SOLID | {"contype": 4, "conaffinity": 2}),  # it touches things and the arm, not the table below it
    )


def _add_object(world: mujoco.MjSpec, item: CellObject, place: Array) -> None:
    """A free box, or a sheet that stays where it is put (MuJoCo's mocap body); at first apart from all others."""
    import mujoco

    if item.size is not None:
        body = world.worldbody.add_body(name=item.name, pos=place)
        body.add_freejoint(name=item.name)
        body.add_geom(
            name=item.name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=np.array(item.size) / 2,
            rgba=(*COLOURS[item.colour], 1.0),
            density=900.0,  # of wood and plastic: 58 g for a cube of 4 cm
            contype=1,
            conaffinity=7,
            condim=4,
            friction=[0.8, 0.01, 0.001],
        )
        return
    x0, y0, x1, y1 = parse_target(str(item.target)).artwork().bounds
    body = world.worldbody.add_body(name=item.name, mocap=True, pos=place)
    body.add_geom(
        name=item.name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=[(x0 + x1) / 2, (y0 + y1) / 2, SHEET_M / 2],
        size=[(x1 - x0) / 2, (y1 - y0) / 2, SHEET_M / 2],
        rgba=(0.9, 0.9, 0.9, 1.0),
        contype=0,
        conaffinity=0,
    )
