"""What a project is: components, observations, options, results and a journal, as frozen records.

    project.components["left"].kind        # camera, rig, projector, robot, tool, target or frame
    project.observations["hand"].camera    # who saw what, from which robot's poses
    project.results[0].file                # below the project's folder

They are checked when they are made; `edits` gives a project with one thing more or less, `folder` reads and writes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import rotations, se3

KINDS = ("camera", "rig", "projector", "robot", "tool", "target", "body", "frame")
SETUPS = ("auto", "eye-in-hand", "eye-to-hand", "standing", "handheld")
TYPED = "typed in"
"""The source of a pose that a person gave."""
MOST_OF_JOURNAL = 500
"""Commands that the journal holds; of older ones the number is kept."""

_FIELDS: Mapping[str, frozenset[str]] = {
    "camera": frozenset({"file", "name_in_file", "start", "model", "fix"}),
    "rig": frozenset({"cameras", "time_offsets", "readout", "fps", "times"}),
    "projector": frozenset({"camera", "file", "name_in_file", "size", "code", "period_px", "shifts", "model", "fix"}),
    "robot": frozenset({"accuracy", "chain", "chain_link", "chain_base", "joint_angle", "identify"}),
    "tool": frozenset({"robot"}),
    "target": frozenset({"spec"}),
    "body": frozenset({"targets"}),
    "frame": frozenset(),
}
"""What a component of each kind can say, beside where it is."""


@dataclass(frozen=True, kw_only=True)
class Placement:
    """Where a component is, as a person or a file says: no uncertainty belongs to it.

    xyz_mm in the frame `relative_to`; ypr_deg, yaw, pitch and roll (z-y'-x''), or rotation, nine numbers row by row;
    source: "typed in", or the file that says so.
    """

    relative_to: str
    xyz_mm: tuple[float, ...]
    ypr_deg: tuple[float, ...] = ()
    rotation: tuple[float, ...] = ()
    source: str

    def __post_init__(self) -> None:
        if (len(self.xyz_mm), len(self.ypr_deg), len(self.rotation)) not in ((3, 3, 0), (3, 0, 9)):
            raise InputError(
                f"a pose relative to {self.relative_to!r} has {len(self.xyz_mm)} numbers xyz_mm, {len(self.ypr_deg)} "
                f"ypr_deg and {len(self.rotation)} rotation; expected three xyz_mm, and three ypr_deg or nine rotation"
            )
        if not np.isfinite([*self.xyz_mm, *self.ypr_deg, *self.rotation]).all():
            raise InputError(f"a pose relative to {self.relative_to!r} holds a number that is not finite")
        if self.rotation:
            se3.check(self.matrix, name=f"the pose relative to {self.relative_to!r}")

    @property
    def matrix(self) -> Array:
        """T_relative-to_component (4, 4), metres."""
        given = np.reshape(self.rotation, (3, 3)) if self.rotation else None
        R = rotations.matrix_from_yaw_pitch_roll(self.ypr_deg, unit="deg") if given is None else given
        return se3.make(R, np.array(self.xyz_mm) / 1e3)


@dataclass(frozen=True, kw_only=True)
class Component:
    """A thing of the cell. What each kind can say:

    camera: file, a known lens (any format), called name_in_file there, held, or with `start` only where the search
    begins; model and fix of a lens that is found. projector: the camera that sees its light, its own pixels (size), the
    code of its patterns; rig: cameras, the first of which is its frame; time_offsets and readout ask for their clocks,
    whose times are told by fps (pictures a second) or times (a table). robot: accuracy, "0.3mm" or "0.3mm,0.02deg";
    chain, a file or an arm's name, where its poses are joint values (from chain_base to chain_link, in joint_angle), of
    which `identify` finds errors. tool: the robot that holds it. target: spec. body: targets that are fixed to each
    other, at the first of them. pose: where a person or a file says it is; shown_in: the frame that
    lists show it in, the world unless said.
    """

    kind: str
    pose: Placement | None = None
    shown_in: str = ""
    file: str = ""
    name_in_file: str = ""
    start: bool = False
    model: str = ""
    fix: tuple[str, ...] = ()
    cameras: tuple[str, ...] = ()
    camera: str = ""
    size: tuple[int, ...] = ()
    code: str = "gray"
    period_px: int = 16
    shifts: int = 8
    accuracy: str = ""
    robot: str = ""
    spec: str = ""
    time_offsets: bool = False
    readout: bool = False
    fps: float = 0.0
    times: str = ""
    chain: str = ""
    chain_link: str = ""
    chain_base: str = ""
    joint_angle: str = "auto"
    identify: tuple[str, ...] = ()
    targets: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"no kind of component is called {self.kind!r}; kinds: {', '.join(KINDS)}")
        allowed = _FIELDS[self.kind] | {"kind", "pose", "shown_in"}
        said = [f.name for f in fields(self) if getattr(self, f.name) != f.default and f.name not in allowed]
        if said:
            raise InputError(
                f"a {self.kind} has no {said[0]}; it can say: {', '.join(sorted(_FIELDS[self.kind])) or 'its pose'}"
            )
        needs = {"target": "spec", "rig": "cameras", "body": "targets"}.get(self.kind)
        if needs and not getattr(self, needs):
            raise InputError(f"a {self.kind} needs its {needs}")
        if self.kind == "body" and len(set(self.targets)) < 2:
            raise InputError(
                f"a body is two targets or more that are fixed to each other; got {', '.join(self.targets)}"
            )
        if self.identify and not self.chain:
            raise InputError(
                "errors of a robot's joints are found from their values: a robot that says identify says chain"
            )
        if not 0 <= self.fps < float("inf") or (self.fps and self.times):
            raise InputError(
                "a rig's times are told by fps, pictures a second above 0, or by a table of times, not both"
            )
        if self.size and (len(self.size) != 2 or min(self.size) < 1):
            raise InputError(f"a projector's size is {list(self.size)}, expected its width and height in pixels")


@dataclass(frozen=True, kw_only=True)
class Notation:
    """How robot poses are written, as the options --pose-units … and --robot-format have it."""

    units: str = "auto"
    rotation: str = "auto"
    angle: str = "auto"
    direction: str = "auto"
    maker: str = ""


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A bag of ROS 1 or 2 in place of images and files of poses, as the options of `hand-eye --bag` have it.

    topic: of the pictures; tf, "base:tool", or joint_topic: where the robot's poses are; moments: still or moving;
    clock_offset: what is added to the pictures' times to be the robot's, "37ms".
    """

    bag: str
    topic: str = ""
    stamps: str = "header"
    tf: str = ""
    joint_topic: str = ""
    moments: str = "still"
    clock_offset: str = ""


@dataclass(frozen=True, kw_only=True)
class Seen:
    """What one camera saw of one target: images, a recording's pictures, captures of a projector's patterns, or points
    found before (of the projector too, where one is named).

    setup: eye-in-hand or eye-to-hand (auto: the data tell) with the robot's poses, standing, or handheld. Cameras of
    one rig that see a handheld target took its images at once. Paths are from the project's folder, or absolute.
    """

    camera: str
    target: str = ""
    setup: str = "handheld"
    images: tuple[str, ...] = ()
    captures: tuple[str, ...] = ()
    points: str = ""
    projector: str = ""
    robot: str = ""
    poses: tuple[str, ...] = ()
    notation: Notation = Notation()
    mirror_x: bool = False
    exclude: tuple[str, ...] = ()
    recording: Recording | None = None

    def __post_init__(self) -> None:
        if sum(map(bool, (self.images, self.captures, self.points, self.recording))) != 1:
            raise InputError("observations are images, a bag, captures or a file of points: name one of them")
        if not self.target and not self.points:
            raise InputError("images need the target they show: a target of the project by its name")
        if self.setup not in SETUPS:
            raise InputError(f"unknown setup {self.setup!r}; choose {', '.join(SETUPS)}")
        at_robot = self.setup not in ("handheld", "standing")
        if self.recording is not None and self.poses:
            raise InputError("a bag has the robot's poses itself: leave the files of poses out")
        if bool(self.robot) != at_robot or (self.recording is None and bool(self.robot) != bool(self.poses)):
            raise InputError(
                f"setup {self.setup}, robot {self.robot!r} with {len(self.poses)} files of poses: eye-in-hand, "
                "eye-to-hand and auto take a robot and its poses; handheld and standing take neither"
            )
        if (self.captures and not self.projector) or (self.projector and (self.images or self.recording)):
            raise InputError("captures are photos of a projector's patterns: name the projector, and captures with it")


@dataclass(frozen=True, kw_only=True)
class Touched:
    """Poses of a robot at which the tip of a tool touches one point that nobody knows, or corners of a target.

    corners: the number of the target's point that each pose touches, in the poses' order.
    """

    tool: str
    robot: str
    poses: tuple[str, ...]
    notation: Notation = Notation()
    target: str = ""
    corners: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not self.poses:
            raise InputError("touches are poses of a robot: name their files")
        if bool(self.target) != bool(self.corners):
            raise InputError("touches of a target name the corner of each (corners), touches of a point name neither")


@dataclass(frozen=True, kw_only=True)
class ProjectOptions:
    """How all is calibrated where a component says nothing else: the model of lenses, and what of them is held."""

    model: str = "brown"
    fix: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Kept:
    """A result of the project. of: "seen" (observations found), "cell" (calibrated) or "given" (read from a file).

    file, below the project's folder, and its sha256; name, what it is of; key: a hash of everything it was made from;
    robots: those that it has, in their order: whose frames "base" and "gripper" are.
    """

    of: str
    name: str
    file: str
    sha256: str
    key: str = ""
    made: str = ""
    robots: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A line of the journal: when, and the command."""

    at: str
    command: str


@dataclass(frozen=True, kw_only=True)
class Project:
    """All of it. world: the frame that poses are shown in; earlier: commands that the journal no longer holds."""

    created: str = ""
    version: str = ""
    world: str = ""
    components: Mapping[str, Component] = field(default_factory=dict)
    observations: Mapping[str, Seen] = field(default_factory=dict)
    touches: Mapping[str, Touched] = field(default_factory=dict)
    options: ProjectOptions = ProjectOptions()
    results: tuple[Kept, ...] = ()
    earlier: int = 0
    journal: tuple[Entry, ...] = ()

    def of_kind(self, kind: str) -> tuple[str, ...]:
        """Names of the components of a kind."""
        return tuple(name for name, c in self.components.items() if c.kind == kind)

    def component(self, name: str, *, kind: str = "") -> Component:
        """The component of that name, of that kind. Raises: InputError listing those that there are."""
        found = self.components.get(name)
        if found is None or (kind and found.kind != kind):
            there = ", ".join(self.of_kind(kind) if kind else self.components) or "none"
            what = kind or "component"
            also = f" ({name!r} is a {found.kind})" if found is not None else ""
            raise InputError(f"the project has no {what} called {name!r}{also}; {what}s: {there}")
        return found

    def rig_of(self, camera: str) -> str:
        """The rig that a camera belongs to; empty for one of none."""
        return next((n for n, c in self.components.items() if camera in c.cameras), "")

    def body_of(self, target: str) -> str:
        """The body that a target belongs to; empty for one of none."""
        return next((n for n, c in self.components.items() if target in c.targets), "")
