"""A parallel gripper with two fingers on the flange, and what it can carry: a pen, a board on a stick.

Fingers move along the flange's y; they end `FINGER_END_M` beyond the flange, along its z.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibrant.arrays import Array
from calibrant.geometry import se3, so3
from calibrant.simulate.robot_cell.arm.arms import ARM_CONTACT
from calibrant.simulate.robot_cell.arm.servos import add_finger_servo
from calibrant.targets.target import Target

if TYPE_CHECKING:
    import mujoco

FINGER_END_M = 0.112
"""From the flange to the fingers' ends: that of Franka's hand, whose pads' middle is at 103.4 mm (data sheet)."""
PEN_END_M = 0.170
STROKE_M = 0.08
GRIP_N = 40.0
"""Force of each finger; Franka's hand holds with 70 N."""
FINGERS = ("left finger", "right finger")

_DARK = (0.20, 0.21, 0.23, 1.0)
_PAD = (0.12, 0.12, 0.12, 1.0)
_TOOL_GROUP = {"contype": 0, "conaffinity": 0, "density": 5.0}


def add_gripper(world: mujoco.MjSpec, flange: mujoco.MjsBody) -> None:
    """The hand, its fingers with rubber pads, their servos."""
    import mujoco

    box = mujoco.mjtGeom.mjGEOM_BOX
    hand = flange.add_body(name="hand", gravcomp=1.0)
    hand.add_geom(name="hand", type=box, pos=[0, 0, 0.033], size=[0.02, 0.095, 0.033], rgba=_SHELL, **ARM_CONTACT)
    for name, side in zip(FINGERS, (1.0, -1.0)):
        finger = hand.add_body(name=name, pos=[0, 0, 0.066], gravcomp=1.0)
        finger.add_joint(
            name=name,
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=[0, side, 0],
            range=[0, STROKE_M / 2],
            limited=True,
            armature=0.1,
            damping=np.array([10.0, 0.0, 0.0]),
        )
        length = FINGER_END_M - 0.066
        finger.add_geom(
            type=box, pos=[0, side * 0.012, length / 2], size=[0.009, 0.006, length / 2], rgba=_DARK, **ARM_CONTACT
        )
        finger.add_geom(
            name=f"{name} pad",
            type=box,
            pos=[0, side * 0.004, length - 0.011],
            size=[0.009, 0.004, 0.011],
            rgba=_PAD,
            friction=[1.5, 0.02, 0.001],
            condim=6,
            contype=2,
            conaffinity=0,
            density=600.0,
            solref=[0.004, 1.0],
            priority=1,  # the pads' friction and stiffness rule, whatever they hold
        )
        add_finger_servo(world, name, force_n=GRIP_N)
    both = world.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=FINGERS[0], name2=FINGERS[1])
    both.data[:5] = [0, 1, 0, 0, 0]
    both.objtype = mujoco.mjtObj.mjOBJ_JOINT


_SHELL = (0.80, 0.80, 0.82, 1.0)


def add_tools(flange: mujoco.MjsBody, board: Target, stick_m: float) -> None:
    """The pen and the stick with its board, hidden; `tool_geoms` names what is shown."""
    import mujoco

    pen = flange.add_body(name="pen", gravcomp=1.0)
    pen.add_geom(
        name="pen shaft",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        fromto=[0, 0, 0.07, 0, 0, PEN_END_M - 0.02],
        size=[0.005, 0, 0],
        rgba=(0.1, 0.1, 0.3, 0.0),
        **_TOOL_GROUP,
    )
    pen.add_geom(
        name="pen point",
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[0, 0, PEN_END_M - 0.02, 0, 0, PEN_END_M - 0.001],
        size=[0.001, 0, 0],
        rgba=(0.1, 0.1, 0.1, 0.0),
        **_TOOL_GROUP,
    )
    stick = flange.add_body(name="stick", gravcomp=1.0)
    stick.add_geom(
        name="stick rod",
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[0, 0, 0.07, 0, 0, FINGER_END_M + stick_m],
        size=[0.006, 0, 0],
        rgba=(0.5, 0.45, 0.4, 0.0),
        **_TOOL_GROUP,
    )
    T = T_gripper_stick_board(board, stick_m)
    x0, y0, x1, y1 = board.artwork().bounds
    sheet = stick.add_body(name="stick board", pos=T[:3, 3], quat=so3.quaternion_wxyz(T[:3, :3]), gravcomp=1.0)
    sheet.add_geom(
        name="stick board",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=[(x0 + x1) / 2, (y0 + y1) / 2, 0.0015],
        size=[(x1 - x0) / 2, (y1 - y0) / 2, 0.0015],
        rgba=(0.9, 0.9, 0.9, 0.0),
        **_TOOL_GROUP,
    )


TOOL_GEOMS: dict[str, tuple[str, ...]] = {
    "pen": ("pen shaft", "pen point"),
    "stick": ("stick rod", "stick board"),
}


def T_gripper_stick_board(board: Target, stick_m: float) -> Array:
    """The board is held like a paddle: the stick's end at its lower edge, its face along the flange's -x.

    The target's y (down the rows) runs back along the stick, its z (into the board) along the flange's x.
    """
    x0, _, x1, y1 = board.artwork().bounds
    R = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    start = np.array([-0.008, 0.0, FINGER_END_M + stick_m])
    # The middle of the sheet's lower edge lies on the stick, 8 mm before its axis.
    return se3.make(R, start - R @ np.array([(x0 + x1) / 2, y1, 0.0]))


def tip_end_m(tool: str | None) -> float:
    """How far beyond the flange the tip is, along its z: the pen's point, or the fingers' ends."""
    return PEN_END_M if tool == "pen" else FINGER_END_M
