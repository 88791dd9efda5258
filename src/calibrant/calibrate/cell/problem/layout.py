"""A cell: which cameras, robots and targets there are, who is mounted where, and the links of each picture.

    eye-in-hand  T_camera_target = T_gripper_camera^-1 T_base_gripper^-1 [T_root_base^-1] T_root_target
    eye-to-hand  T_camera_target = T_root_camera^-1 [T_root_base] T_base_gripper T_gripper_target
    standing     T_camera_target = T_root_camera^-1 T_root_target
    handheld     T_camera_target = [T_body_camera^-1] T_body_carrier(moment) [T_carrier_target]
    hand-to-hand T_camera_target = T_gripper_camera^-1 T_base_gripper^-1 T_root_base^-1
                   T_root_base' T_base'_gripper' T_gripper'_target        (' of the other robot)

A single camera on a single robot is a cell of one list. The root is the first robot's base; [T_root_base] is there for
every other robot. A rig is a cell without robots: its root is a camera, which has no [T_body_camera] then. A handheld
target is somewhere else at every moment, in the frame of what the cameras that see it are fixed to, their body: the
root, or the gripper that carries them all; of several that are fixed to each other the first is the carrier.
What stands still is one unknown in the root, what a robot carries is one in its gripper: cameras that see the same
target, robots that carry or show one to the same camera, share these unknowns, and through them their errors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.calibrate.cell.problem.groups import ONLY_ROBOT as ONLY_ROBOT
from calibrant.calibrate.cell.problem.layout_checks import check_layout
from calibrant.calibrate.cell.problem.touches import Touches
from calibrant.calibrate.reprojection.links import Link
from calibrant.data import DEFAULT_CAMERA, Observations, RobotPoses
from calibrant.errors import InputError
from calibrant.expected import expect
from calibrant.geometry import se3

Frame = tuple[str, str]
"""(parent, child)."""

IN_HAND, TO_HAND, STANDING, HAND_TO_HAND = "eye-in-hand", "eye-to-hand", "standing", "hand-to-hand"
HANDHELD = "handheld"
ARRANGEMENTS = (IN_HAND, TO_HAND, STANDING, HAND_TO_HAND, HANDHELD)
TARGET = "target"


@dataclass(frozen=True, eq=False)
class TargetPoses:
    """Target poses that were measured elsewhere, in place of images: ids (n,) of the robot's poses they belong to, and
    T_camera_target (n, 4, 4), metres.

        >>> import calibrant as cb, numpy as np
        >>> cb.TargetPoses(("0", "1"), np.stack([np.eye(4)] * 2)).T_camera_target.shape
        (2, 4, 4)
    """

    ids: tuple[str, ...]
    T_camera_target: Array

    def __post_init__(self) -> None:
        T = se3.check(self.T_camera_target, name="T_camera_target").reshape(-1, 4, 4)
        if len(T) != len(self.ids):
            raise InputError(
                f"{len(self.ids)} robot poses but {len(T)} target poses; every robot pose needs its target pose"
            )
        object.__setattr__(self, "T_camera_target", T)

    def __repr__(self) -> str:
        return f"TargetPoses({len(self.ids)} poses)"


@dataclass(frozen=True, eq=False)
class Pictures:
    """What one camera saw at poses of one robot: views whose `moment` is the pose's id, or measured target poses.

    setup: eye-in-hand (the robot carries the camera), eye-to-hand (it carries the target), standing (neither: camera
    and target stand beside the robot, which takes no part), hand-to-hand (it carries the camera, and robot `other` the
    target: a view's moment is the id of a pose of each), handheld (somebody moves the target before cameras that are
    fixed to each other, and no robot knows where it is: views of one `moment` were taken at once). target: name of the
    target, where there are several.

    Example::

        left = cb.Pictures("left", "eye-in-hand", observations_of_left)
        result = cb.calibrate_cell(robot_poses, [left, cb.Pictures("top", "eye-to-hand", observations_of_top)])
    """

    camera: str
    setup: str
    observations: Observations | TargetPoses
    robot: str = ONLY_ROBOT
    target: str = TARGET
    other: str = ""

    def __post_init__(self) -> None:
        if self.setup not in ARRANGEMENTS:
            raise InputError(
                f"unknown setup {self.setup!r} of camera {self.camera!r}; choose {', '.join(ARRANGEMENTS)}"
            )
        if (self.setup == HAND_TO_HAND) != bool(self.other) or self.other == self.robot != "":
            raise InputError(
                f"camera {self.camera!r}, {self.setup}: hand-to-hand goes with another robot that carries the target "
                f"(other={self.other!r}), and nothing else does"
            )
        if self.handheld:
            if self.robot not in ("", ONLY_ROBOT) or self.seen is None:
                raise InputError(
                    f"camera {self.camera!r}, {HANDHELD}: takes views, and no robot (robot={self.robot!r}); where the "
                    "target was is found from the images"
                )
            object.__setattr__(self, "robot", "")
        if self.seen is not None and len(self.seen.image_sizes) != 1:
            named = ", ".join(self.seen.image_sizes)
            raise InputError(f"the pictures of camera {self.camera!r} are of several: {named}; give one list a camera")

    @property
    def seen(self) -> Observations | None:
        """The views; None for target poses that were measured elsewhere."""
        return self.observations if isinstance(self.observations, Observations) else None

    @property
    def handheld(self) -> bool:
        """Whether nobody says where the target was: its pose at every moment is an unknown."""
        return self.setup == HANDHELD

    @property
    def alone(self) -> bool:
        """Whether these pictures are a hand-eye problem of their own, A_i X B_i = Z."""
        return len(self.movers) == 1

    @property
    def words(self) -> str:
        """The pictures, for messages."""
        at = "" if self.robot in ("", ONLY_ROBOT) else f" at {self.robot}"
        to = f", target on {self.other}" if self.other else ""
        return f"camera {self.camera}{at} ({self.setup}{to})"

    @property
    def camera_robot(self) -> str | None:
        """The robot that carries the camera."""
        return self.robot if self.setup in (IN_HAND, HAND_TO_HAND) else None

    @property
    def target_robot(self) -> str | None:
        """The robot that carries the target."""
        return self.other or (self.robot if self.setup == TO_HAND else None)

    @property
    def movers(self) -> tuple[str, ...]:
        """The robots between camera and target."""
        return tuple(r for r in (self.camera_robot, self.target_robot) if r is not None)


@dataclass(frozen=True, eq=False)
class Layout:
    """The frames of a cell: robots by name, and the pictures taken there.

    reference: the camera whose frame is the root where there are no robots; by default the first. rigid: names of
    handheld targets that are fixed to each other, group by group; the first of a group is the others' carrier. touches:
    poses at which tools touch targets, or points.
    """

    robots: Mapping[str, RobotPoses]
    pictures: tuple[Pictures, ...]
    reference: str = ""
    rigid: tuple[tuple[str, ...], ...] = ()
    touches: tuple[Touches, ...] = ()

    def __post_init__(self) -> None:
        check_layout(self)

    @property
    def rig(self) -> bool:
        """Whether this is a rig, a cell without robots."""
        return not self.robots

    @property
    def plain(self) -> bool:
        """Whether there is one camera on or before one robot, with the frames' usual names."""
        first = self.pictures[0]
        return len(self.pictures) == 1 and first.alone and (first.camera, first.target) == (DEFAULT_CAMERA, TARGET)

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras in the order given."""
        return tuple(dict.fromkeys(p.camera for p in self.pictures))

    @property
    def cameras_with_images(self) -> tuple[str, ...]:
        """Those whose lists are views, not measured target poses."""
        return tuple(dict.fromkeys(p.camera for p in self.pictures if p.seen is not None))

    @property
    def root(self) -> str:
        """The frame of all that stands still: the first robot's base; without robots, the reference camera's."""
        return self.reference or self.cameras[0] if self.rig else self.base(next(iter(self.robots)))

    def base(self, robot: str) -> str:
        """Frame of a robot's base: "base" for the only robot."""
        return "base" if len(self.robots) == 1 else f"{robot}_base"

    def gripper(self, robot: str) -> str:
        """Frame of a robot's gripper: "gripper" for the only robot."""
        return "gripper" if len(self.robots) == 1 else f"{robot}_gripper"

    def fixed_to(self, p: Pictures) -> str:
        """What these pictures by themselves say that the camera is fixed to; handheld targets say nothing of it."""
        return self.root if p.camera_robot is None else self.gripper(p.camera_robot)

    @cached_property
    def by_hand(self) -> tuple[tuple[str, ...], ...]:
        """The cameras that see handheld targets, group by group: those that one target ties, or targets fixed to each
        other. All of a rig are one group, its root the first."""
        if self.rig:
            return ((self.root, *(c for c in self.cameras if c != self.root)),)
        groups: list[dict[str, None]] = []
        for carrier in dict.fromkeys(self.carrier(p) for p in self.pictures if p.handheld):
            mine = dict.fromkeys(p.camera for p in self.pictures if p.handheld and self.carrier(p) == carrier)
            for group in [g for g in groups if mine.keys() & g.keys()]:
                groups.remove(group)
                mine = group | mine
            groups.append(mine)
        return tuple(tuple(g) for g in groups)

    @cached_property
    def _bodies(self) -> Mapping[str, str]:
        """By camera, what it is fixed to: a camera that sees handheld targets alone stands where those that see them
        beside it do."""
        said = {p.camera: self.fixed_to(p) for p in self.pictures if not p.handheld}
        out = dict.fromkeys(self.cameras, self.root)
        for group in self.by_hand:
            out |= dict.fromkeys(group, next((said[c] for c in group if c in said), self.root))
        return out | said

    def camera_parent(self, p: Pictures) -> str:
        """What the camera is fixed to."""
        return self._bodies[p.camera]

    def target_parent(self, p: Pictures) -> str:
        """What the target is fixed to; of a handheld one, in what frame it is found at every moment: its cameras'."""
        if p.handheld:
            return self.camera_parent(p)
        return self.root if p.target_robot is None else self.gripper(p.target_robot)

    def target(self, p: Pictures) -> str:
        """Frame of the target where it was for these pictures: a board that was moved from a table into a gripper, or
        into a hand, is two frames."""
        return f"{self._whereabouts(p)}_{p.target}" if p.target in self._elsewhere else p.target

    @cached_property
    def _elsewhere(self) -> frozenset[str]:
        """Targets that are at several places."""
        places = {(p.target, self._whereabouts(p)) for p in self.pictures}
        names = [name for name, _ in places]
        return frozenset(name for name in names if names.count(name) > 1)

    def _whereabouts(self, p: Pictures) -> str:
        return HANDHELD if p.handheld else self.target_parent(p)

    def carrier(self, p: Pictures) -> str:
        """Frame of the target that p's is fixed to: its own, where it is fixed to none."""
        group = next((g for g in self.rigid if p.handheld and p.target in g), None)
        return self.target(p) if group is None else self._by_hand(group[0])

    def _by_hand(self, name: str) -> str:
        """Frame of a target, by its name, where somebody moves it."""
        return self.target(next(q for q in self.pictures if q.handheld and q.target == name))

    @property
    def targets(self) -> tuple[str, ...]:
        """Frames of all targets."""
        return tuple(dict.fromkeys(self.target(p) for p in self.pictures))

    @property
    def target_names(self) -> tuple[str, ...]:
        """Names of the targets as things, wherever they are."""
        return tuple(dict.fromkeys(p.target for p in self.pictures))

    @cached_property
    def unknown(self) -> tuple[Frame, ...]:
        """The transforms to be found: cameras, targets, the other robots' bases, tips and points that they touch."""
        cameras = {(self.camera_parent(p), p.camera): None for p in self.pictures if p.camera != self.root}
        targets = {(self.target_parent(p), self.target(p)): None for p in self.pictures if not p.handheld}
        rigid = [(self._by_hand(group[0]), self._by_hand(name)) for group in self.rigid for name in group[1:]]
        bases = [(self.root, self.base(r)) for r in self.robots if self.base(r) != self.root]
        return (*cameras, *targets, *rigid, *bases, *self.positions)

    @property
    def positions(self) -> tuple[Frame, ...]:
        """Those that are a place alone, with their parent's axes: tips, and points that nobody knows."""
        points = [self.touched(t) for t in self.touches if not t.target]
        return tuple(dict.fromkeys((*map(self.tip, self.touches), *points)))

    def tip(self, t: Touches) -> Frame:
        """The tip of these touches."""
        return self.gripper(t.robot), t.tool

    def touched(self, t: Touches) -> Frame:
        """What is touched: a target that stands still, or a point."""
        if not t.target:
            return self.root, t.point
        return self.root, self.target(next(p for p in self.pictures if p.target == t.target and self.stands(p)))

    def stands(self, p: Pictures) -> bool:
        """Whether the target stood still in the root for these pictures."""
        return not p.handheld and p.target_robot is None

    @property
    def handheld(self) -> tuple[Frame, ...]:
        """Targets that are somewhere else at every moment: one unknown each, but for those that another carries."""
        return tuple(dict.fromkeys((self.target_parent(p), self.carrier(p)) for p in self.pictures if p.handheld))

    def label(self, i: int) -> str:
        """What tells list i from the others; empty for the only one."""
        if len(self.pictures) == 1:
            return ""
        names = [p.camera if len(self.robots) <= 1 or p.handheld else f"{p.camera} at {p.robot}" for p in self.pictures]
        return names[i] if names.count(names[i]) == 1 else f"{names[i]} {i + 1}"

    def prefix(self, i: int) -> str:
        """What messages about list i begin with; nothing for the only one."""
        return "" if len(self.pictures) == 1 else f"{self.pictures[i].words}: "

    def constants(self, p: Pictures) -> tuple[Frame, Frame]:
        """What pictures with a robot between camera and target tell: the camera's place and the target's, each by what
        it stands on or hangs from at this robot."""
        base, gripper = self.base(p.robot), self.gripper(p.robot)
        camera, target = (gripper, base) if p.setup == IN_HAND else (base, gripper)
        return (camera, p.camera), (target, self.target(p))

    def links(self, p: Pictures, rows: Mapping[str, Indices], count: int) -> list[Link]:
        """T_camera_target of `count` views at rows (count,) of the poses of each robot between camera and target, or,
        by its name, of the moments of a handheld target's carrier."""
        once = np.zeros(count, dtype=np.int64)
        camera = self._reach(p.camera_robot, rows, once)
        if p.camera != self.root:
            camera.append(Link(variable((self.camera_parent(p), p.camera)), once))
        target = self._reach(p.target_robot, rows, once)
        if p.handheld:
            carrier = self.carrier(p)
            target.append(Link(variable((self.target_parent(p), carrier)), rows[carrier]))
            if carrier != self.target(p):
                target.append(Link(variable((carrier, self.target(p))), once))
        else:
            target.append(Link(variable((self.target_parent(p), self.target(p))), once))
        return [*(replace(k, inverted=True) for k in reversed(camera)), *target]

    def _reach(self, robot: str | None, rows: Mapping[str, Indices], once: Indices) -> list[Link]:
        """T_root_gripper of a robot; nothing for none. A camera and a target on one robot's side share its base."""
        if robot is None:
            return []
        base = [] if self.base(robot) == self.root else [Link(variable((self.root, self.base(robot))), once)]
        return [*base, Link(poses_variable(robot), rows[robot])]


def id_prefix(lists: Sequence[tuple[str, str]], i: int) -> str:
    """What the view ids of list i begin with: the robot's name, or a handheld target's, where a camera stands in
    several lists.

    lists: (camera, robot or handheld target) of each.
    """
    camera, by = lists[i]
    if [c for c, _ in lists].count(camera) == 1:
        return ""
    return f"{by}/{i}/" if lists[i] in lists[:i] else f"{by}/"


def variable(frame: Frame) -> str:
    """Name of a transform's unknown."""
    return f"T_{frame[0]}_{frame[1]}"


def poses_variable(robot: str) -> str:
    """Name of a robot's true poses."""
    return f"poses of {robot}"


def layout(
    robots: Mapping[str, RobotPoses] | RobotPoses,
    pictures: Sequence[Pictures],
    reference: str = "",
    rigid: Sequence[Sequence[str]] = (),
    touches: Sequence[Touches] = (),
) -> Layout:
    """The layout of a cell. Raises: InputError for names that do not fit, no pictures, no robots where any is named."""
    expect(robots, (RobotPoses, Mapping), "robots", "RobotPoses, or those of each robot by its name")
    named = {ONLY_ROBOT: robots} if isinstance(robots, RobotPoses) else dict(robots)
    for name, poses in named.items():
        expect(poses, RobotPoses, f"the poses of robot {name!r}", "RobotPoses")
    expect(touches, (list, tuple), "touches", "a list of Touches, one for each tool and what it touches")
    for t in touches:
        expect(t, Touches, "one of touches", "Touches")
    if not pictures or not (named or all(p.handheld for p in pictures)):
        raise InputError(
            "nothing to calibrate: give the poses of one robot or more, and the pictures of each camera; cameras "
            f"without a robot see a target that is {HANDHELD}"
        )
    cameras = list(dict.fromkeys(p.camera for p in pictures))
    if not named and len(cameras) < 2 and not rigid:
        raise InputError(f"a rig has two cameras or more, the pictures are of {len(cameras)}: {', '.join(cameras)}")
    return Layout(named, tuple(pictures), reference, tuple(tuple(group) for group in rigid), tuple(touches))
