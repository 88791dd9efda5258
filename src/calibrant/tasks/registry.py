"""Every command and its task: one line each. A new command is one file and one line here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Protocol

from calibrant.errors import CalibrantError
from calibrant.reading.notes import heard
from calibrant.tasks.listener import Listener
from calibrant.tasks.outcome import Outcome


class Task(Protocol):
    """A module that does a command's work; `reads` and `BESIDE` where it has them (see `reads_of`)."""

    Request: type
    EXAMPLE: str

    @property
    def run(self) -> Callable[[Any, Listener], Outcome]:
        """From a request to its outcome."""
        ...


@dataclass(frozen=True)
class Entry:
    """module: where the task is; words: one line for lists; outputs: the files that every result can go to, of "out",
    "report" and "json"; out: what --out is, where it is no result file; judged: whether the answer is a result with a
    verdict; package: where the module is: a skin that is no terminal, such as the node, has its commands with it."""

    module: str
    words: str
    outputs: tuple[str, ...] = ("out", "report", "json")
    out: str = "Write the result file (JSON) here."
    judged: bool = True
    package: str = "tasks"

    def load(self) -> Task:
        """The task's module."""
        return import_module(f"calibrant.{self.package}.{self.module}")


TASKS = {
    "demo": Entry("demo.chain", "The whole chain on a simulated robot cell.", ("json",)),
    "capture": Entry("boards.capture", "Take views from a running camera until it is known."),
    "target": Entry("boards.target", "Print a board at true size.", (), judged=False),
    "detect": Entry(
        "boards.detect",
        "Find a board in photos.",
        ("out", "json"),
        "Write the observations file (JSON) here.",
        judged=False,
    ),
    "intrinsics": Entry("cameras.intrinsics", "Calibrate a camera from photos of a board."),
    "stereo": Entry("cameras.stereo", "Calibrate two cameras that are fixed to each other."),
    "rig": Entry("cameras.rig", "Calibrate any number of cameras that are fixed to each other."),
    "hand-eye": Entry("robots.hand_eye", "Find where the camera is, on a robot or beside it."),
    "hand-eye-point": Entry("cameras.one_point", "Find where a depth camera is, from one point that it sees."),
    "doctor": Entry("robots.doctor", "Find what is wrong with hand-eye or stereo data, and repair it."),
    "pose": Entry("cameras.pose", "Find where a target is, from photos."),
    "locate": Entry("cameras.locate", "Find where an object of known shape is, from colour and depth."),
    "vanishing": Entry("cameras.vanishing", "Find how a camera is turned, from a scene's edges."),
    "undistort": Entry("cameras.undistort", "Undistort photos.", ("json",), judged=False),
    "rectify": Entry("stereo.rectify", "Rectify pairs of pictures: matches then share a row.", ("report", "json")),
    "depth": Entry("stereo.depth", "Measure the depth of what two pictures show."),
    "epipolar": Entry("stereo.epipolar", "Find how two pictures see each other, from what both show."),
    "point": Entry("stereo.point", "Find the spot that a pointer points at, seen by two uncalibrated cameras."),
    "study methods": Entry(
        "studies.methods",
        "Compare all ways to calibrate a camera.",
        out="Write every figure (JSON) here.",
        judged=False,
    ),
    "study paper-tables": Entry(
        "studies.paper_tables",
        "Read a cuboid's pose as the paper did, in both frames.",
        out="Write every figure (JSON) here.",
        judged=False,
    ),
    "report": Entry("results.report", "Show a result file, or make its HTML report.", ()),
    "compare": Entry("results.compare", "Compare two calibrations: pixels, parameters, mm and deg."),
    "convert": Entry("results.convert", "Convert cameras, rigs and transforms between programs.", ("json",)),
    "kinematics": Entry("robots.kinematics", "Identify and correct a robot's geometry.", ("report", "json")),
    "next-pose": Entry("robots.next_pose", "Say which poses to take next, or from the start.", ("report", "json")),
    "time-offset": Entry("robots.time_offset", "Find the offset between camera's and robot's clocks."),
    "dynamic": Entry("robots.dynamic", "Locate a camera beside the robot through the wrist camera."),
    "projector patterns": Entry("projector.patterns", "Write the patterns that a projector shows.", (), judged=False),
    "projector calibrate": Entry("projector.calibrate", "Calibrate a projector from photos of what it shows."),
    "scan": Entry("projector.scan", "Measure a scene by a projector's patterns."),
    "tool touch": Entry("robots.tool_touch", "The tip from poses in which it touches one point."),
    "tool seen": Entry("robots.tool_seen", "The tip from poses in which a camera that stands still sees it."),
    "tool self-visibility": Entry(
        "robots.tool_self_visibility", "Where a hand camera sits, from one photo of the gripper it sees."
    ),
    "project new": Entry("project.new", "Make a project, empty or from another program's.", ("json",), judged=False),
    "project add": Entry("project.add", "Add a component or observations to a project.", ("json",), judged=False),
    "project list": Entry("project.list", "List a project's components and where they are.", ("json",), judged=False),
    "project set": Entry("project.set", "Type in where a component is; choose the world.", ("json",), judged=False),
    "project rename": Entry("project.rename", "Give a component another name.", ("json",), judged=False),
    "project remove": Entry("project.remove", "Remove a component or observations.", ("json",), judged=False),
    "project solve": Entry("project.solve", "Solve what changed in a project.", ("json",), judged=False),
    "project status": Entry("project.status", "Say what of a project is stale, and why.", ("json",), judged=False),
    "project check": Entry("project.check", "Check that all is there that a project names.", ("json",), judged=False),
    "verify unchanged": Entry("verify.unchanged", "Is a calibration still good? One to three photos tell."),
    "verify pinpoint": Entry("verify.pinpoint", "Put the tip to a marker's centre: how far off it is."),
    "verify touch": Entry("verify.touch", "Compare touched points with where the camera says they are."),
    "verify held-out": Entry("verify.held_out", "Try a calibration on views that it never saw."),
    "verify pick-place": Entry("verify.pick_place", "Pick up a cube and set it on another one."),
    "verify stitch": Entry("verify.stitch", "Put depth of many poses together: do the clouds agree?"),
    "verify depth": Entry("verify.depth", "Does a depth camera measure true lengths? Boards tell its scale."),
    "verify watch": Entry("verify.watch", "Has the camera been moved? Picture after picture tells."),
    "servo teach": Entry("servo.teach", "Teach a pose by what a camera sees from there."),
    "servo run": Entry("servo.run", "Lead an arm to a taught pose; tried in simulated cells.", ("json",), judged=False),
    "servo conveyor": Entry(
        "servo.conveyor", "Grasp what a belt carries; tried in simulated cells.", ("json",), judged=False
    ),
    "ros run": Entry("run", "Calibrate a camera beside a running robot, through ROS.", (), package="ros"),
    "ros launch": Entry("launch", "Run the nodes of several cameras.", (), judged=False, package="ros"),
}
"""Every command by its words: "intrinsics", "tool touch"."""
GROUPS = {
    "ros": "Calibrate beside a running robot, and publish what is found.",
    "tool": "Find a tool's tip, by touch or by sight, or a hand camera from the gripper it sees.",
    "verify": "Show whether a calibration holds.",
    "projector": "Calibrate a projector: the patterns it shows, and what a camera makes of them.",
    "project": "A whole cell in a folder: components, observations, results, solved as one problem.",
    "servo": "Lead a robot by what a camera sees: to taught poses, to moving things.",
    "study": "Experiments to learn from: what each method gives, and when it fails.",
}
"""What each group of commands is about: the first word of those that have two."""


def run_task(task: Task, request: Any, listener: Listener) -> Outcome:
    """The outcome of a task, with what readers noted on the way; an error carries their notes too.

    Raises: as the task.
    """
    with heard() as notes:
        try:
            outcome = task.run(request, listener)
        except CalibrantError as error:
            for note in notes:
                error.add_note(note)
            raise
    return outcome.noted(notes)


def reads_of(task: Task, request: Any) -> list[str]:
    """The files that a request names to be read. Raises: InputError where they are not there."""
    reads = getattr(task, "reads", None)
    with heard():  # the task says it again
        return [] if reads is None else [str(file) for file in reads(request)]
