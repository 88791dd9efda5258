"""What `project add` takes: the kinds of components and observations, and the options of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from calibrant.tasks.options.bags import PosedBagOptions
from calibrant.tasks.options.choices import ANGLES, MODELS
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.patterns import PatternOptions
from calibrant.tasks.options.poses import PoseOptions

COMPONENTS = ("camera", "rig", "projector", "robot", "tool", "target", "body", "frame")
OBSERVATIONS = ("images", "bag", "captures", "points", "touches")
KINDS = (*COMPONENTS, *OBSERVATIONS)

_LENS = frozenset({"file", "start", "model", "fix"})
_PATTERNS = frozenset({"projector_size", "code", "period", "shifts"})
_POSES = frozenset({"pose_units", "pose_rotation", "pose_angle", "pose_direction", "robot_format"})
_BAG = frozenset({"bag", "image_topic", "stamps", "tf", "joint_topic", "moments", "clock_offset"})
_SEEN = frozenset({"camera", "target", "setup", "robot", "poses", "mirror_x", "exclude", "more"}) | _POSES
OPTIONS: Mapping[str, frozenset[str]] = {
    "camera": _LENS,
    "rig": frozenset({"cameras", "time_offsets", "readout", "fps", "times"}),
    "projector": _LENS | _PATTERNS | {"camera"},
    "robot": frozenset({"accuracy", "chain", "chain_link", "chain_base", "joint_angle", "identify"}),
    "tool": frozenset({"robot"}),
    "target": frozenset({"spec"}),
    "body": frozenset({"targets"}),
    "frame": frozenset(),
    "images": _SEEN | {"images"},
    "captures": _SEEN | {"captures", "projector"},
    "bag": (_SEEN - {"poses", "robot_format", "more"} - _POSES) | _BAG,
    "points": (_SEEN - {"mirror_x"}) | {"points", "projector"},
    "touches": frozenset({"tool", "robot", "poses", "target", "corners"}) | _POSES,
}
"""The options of each kind."""


@dataclass(frozen=True, kw_only=True)
class ComponentOptions:
    """What components say."""

    file: Annotated[Path | None, Option("FILE")] = None
    """Of a camera or projector: its lens, where it is known (any format), held within its uncertainty."""
    start: bool = False
    """Calibrate the lens all the same, beginning with that of --file."""
    model: Annotated[str, Option("NAME", choices=MODELS)] = ""
    """Of a camera or projector: its model; brown unless given."""
    fix: Annotated[tuple[str, ...], Option("NAMES", names=True)] = ()
    """Of a camera or projector: hold these, e.g. k3, aspect, tangential."""
    cameras: Annotated[tuple[str, ...], Option("NAMES")] = ()
    """Of a rig: the cameras that are fixed to each other; the first one's frame is the rig's."""
    time_offsets: bool = False
    """Of a rig: find how much later than the first camera's each one's pictures are taken; the board must move."""
    readout: bool = False
    """Of a rig: find the time between the first and the last row of each camera's pictures (rolling shutter)."""
    fps: Annotated[float | None, Option("RATE")] = None
    """Of a rig: pictures a second, of numbered images, or of videos that state another rate."""
    times: Annotated[Path | None, Option("FILE")] = None
    """Of a rig: CSV of when each picture was taken: camera, image (or frame) and time, seconds."""
    accuracy: Annotated[str, Option("LENGTH,ANGLE")] = ""
    """Of a robot: how far its flange is off, rms: 0.3mm or 0.3mm,0.02deg."""
    chain: Annotated[str, Option("FILE")] = ""
    """Of a robot whose poses are joint values: URDF, DH table (YAML), or a name such as ur5e."""
    chain_link: Annotated[str, Option("NAME")] = ""
    """Of a robot with a URDF: the link that ends the chain."""
    chain_base: Annotated[str, Option("NAME")] = ""
    """Of a robot with a URDF: the link that starts the chain."""
    joint_angle: Annotated[str, Option("UNIT", choices=ANGLES)] = "auto"
    """Of a robot with joint values: auto (by the limits), deg or rad."""
    identify: Annotated[tuple[str, ...], Option("GROUPS")] = ()
    """Of a robot with joint values: find its own errors too: offsets, gear, coupling, geometry."""
    targets: Annotated[tuple[str, ...], Option("NAMES")] = ()
    """Of a body: the targets that are fixed to each other; the first one's frame is the body's."""
    spec: Annotated[str, Option("SPEC")] = ""
    """Of a target: the board, such as chessboard:9x6:25mm, or a file."""
    patterns: PatternOptions = PatternOptions()


@dataclass(frozen=True, kw_only=True)
class SeenOptions:
    """What observations say. camera, robot and projector are names in the project."""

    camera: Annotated[str, Option("NAME")] = ""
    """Of observations: the camera; of a projector: the camera that sees its light."""
    target: Annotated[str, Option("NAME")] = ""
    """Of observations: the target that was seen."""
    projector: Annotated[str, Option("NAME")] = ""
    """Of captures: the projector that shone."""
    robot: Annotated[str, Option("NAME")] = ""
    """Of observations: the robot at whose poses they were made; of a tool: the one that holds it."""
    setup: Annotated[str, Option("NAME", choices=("auto", "eye-in-hand", "eye-to-hand", "standing", "handheld"))] = ""
    """Of observations: eye-in-hand, eye-to-hand, or auto (with a robot, the default), standing, handheld (without)."""
    images: Annotated[tuple[str, ...], Option("IMAGES", "-i")] = ()
    """Photos, folders, patterns in quotes, or videos; a folder's new photos are noticed by solve."""
    recording: PosedBagOptions = PosedBagOptions()
    captures: Annotated[tuple[str, ...], Option("DIRS")] = ()
    """A folder of photos of all patterns for each pose, or one that holds these folders."""
    points: Annotated[Path | None, Option("FILE")] = None
    """Points found before (calibrant detect --out)."""
    poses: Annotated[tuple[str, ...], Option("FILES")] = ()
    """The robot's poses: a file, or one file a pose."""
    tool: Annotated[str, Option("NAME")] = ""
    """Of touches: the tool whose tip touches."""
    corners: Annotated[tuple[str, ...], Option("NUMBERS")] = ()
    """Of touches of a target: the number of its point that each pose touches, from 0; without them one point."""
    robot_format: Annotated[str, Option("MAKER")] = ""
    """How poses are written: ur, franka, kuka, fanuc, abb, yaskawa, staubli, kawasaki."""
    mirror_x: bool = False
    """The camera delivers mirror images: flip them left to right."""
    exclude: Annotated[tuple[str, ...], Option("NAMES")] = ()
    """Images or captures to leave out, by name."""
    more: bool = False
    """Add to the observations of that name: more images, captures, poses, names to leave out."""
    form: PoseOptions = PoseOptions()
