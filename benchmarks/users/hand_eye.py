"""The conditions of hand-eye calibration, and one run of one of them."""

from __future__ import annotations

import inspect
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

import calibrant as cb
from users import image_faults as f
from users import robot
from users import session_faults as s
from users.cell import TO_HAND, CellDraw, Session, draw_session, least_covariance
from users.intrinsics import observed
from users.rigid import Array, step_between
from users.runs import Run, judged

USUAL = CellDraw()
BESIDE = CellDraw(setup=TO_HAND)
REPEATS = {"mm": (0.02, 0.05), "deg": (0.002, 0.008)}
"""What arms repeat to: their errors are others than their noise."""


@dataclass(frozen=True)
class Condition:
    """A fault, or none: how sessions are drawn, what is done to them, what the person tells.

    known: the data hold what their sigma is. clean: there is nothing to find. told: the robot's accuracy is given, and
    truly.
    """

    name: str
    words: str
    edits: tuple[s.Edit, ...] = ()
    draw: CellDraw = USUAL
    model: str = "brown"
    known: bool = False
    clean: bool = False
    told: bool = False

    @property
    def possible(self) -> bool:
        """Whether the calibrator takes what the person tells."""
        return not self.told or "robot_accuracy" in inspect.signature(cb.calibrate_hand_eye).parameters


def of_the_image() -> list[Condition]:
    C = Condition
    exact, coarse = replace(USUAL, mm=(0.002,) * 2, deg=(0.0005,) * 2), replace(USUAL, mm=(2.0,) * 2, deg=(0.3,) * 2)
    everyday = (s.seen(f.dots_off(0.03)), s.seen(f.bent(0.15)), s.seen(f.shared_noise(0.5, 0.5)))
    alike = (s.seen(f.shared_noise(2.0, 1.5)),)
    return [
        C("clean", "as the model says, white noise, lens from the same photos", clean=True),
        C("clean-lens-given", "the same, the lens given right", (s.lens_given(),), clean=True),
        C("clean-beside", "camera beside the arm", draw=BESIDE, clean=True),
        C("clean-pairs", "target poses instead of photos", (s.measured_pairs(0.1, 0.02),), clean=True),
        C("clean-track", "a camera's track, no drift", (s.track(0.1, 0.02, drift=0.0),), clean=True),
        C("clean-pivot", "motions about one point, target poses", (s.pivoting,), clean=True),
        C("everyday", "dots 0.03 mm, bent 0.15 mm, noise a little alike", everyday, known=True),
        C("robot-exact", "robot noise 0.002 mm, 0.0005 deg", draw=exact, clean=True),
        C("robot-coarse", "robot noise 2 mm, 0.3 deg", draw=coarse, clean=True),
        C("few", "4 to 6 poses", draw=replace(USUAL, photos=replace(USUAL.photos, views=(4, 6))), clean=True),
        C("many", "60 to 80 poses", draw=replace(USUAL, photos=replace(USUAL.photos, views=(60, 80))), clean=True),
        C("shared-noise", "points of a view err alike (2 sigma, 1.5 sigma)", alike, known=True),
        C("shared-noise-beside", "the same, camera beside", alike, BESIDE, known=True),
        C("dots-off", "dots printed 0.2 mm off", (s.seen(f.dots_off(0.2)),), known=True),
        C("wobbling", "paper bent anew in each view, 0.5 mm", (s.seen(f.wobbling(0.5)),), known=True),
        C("heavy-tails", "Student's t of 3", (s.seen(f.heavy_tails),), known=True),
        C("motion-blur", "noise up to 6 times along one direction a view", (s.seen(f.motion_blur(6.0)),), known=True),
        C("outliers", "2 % of points 3 to 20 px off", (s.seen(f.outliers(0.02)),)),
        C("bent-1", "board bent by 1 mm", (s.seen(f.bent(1.0)),)),
        C("bent-3", "board bent by 3 mm", (s.seen(f.bent(3.0)),)),
        C("twisted", "board twisted, corners 1 mm", (s.seen(f.twisted(1.0)),)),
        C("board-0.3", "board 0.3 % smaller than said", (s.seen(f.larger_board(0.003)),), known=True),
        C("board-1", "board 1 % smaller than said", (s.seen(f.larger_board(0.01)),), known=True),
        C("board-4", "board 4 % smaller than said", (s.seen(f.larger_board(0.04)),), known=True),
        C("board-4-beside", "the same, camera beside", (s.seen(f.larger_board(0.04)),), BESIDE, known=True),
        C("board-1-given", "1 %, lens given right", (s.seen(f.larger_board(0.01)), s.lens_given()), known=True),
        C("print-1", "print 1 % longer one way", (s.seen(f.taller(0.01)),)),
        C("zoom-5", "every second view enlarged by 5 %", (s.seen(f.enlarged(0.05)),)),
        C("zoom-1", "every second view enlarged by 1 %", (s.seen(f.enlarged(0.01)),)),
        C("zoom-one", "one view enlarged by 20 %", (s.seen(f.enlarged(0.2, which="one")),)),
        C("refocus", "lens refocused half way, 2 %", (s.seen(f.refocused(0.02)),)),
        C("cropped", "every second view cut 4 %, 3 % further", (s.seen(f.cropped(0.04, 0.03)),)),
        C("mirrored", "every second view mirrored", (s.seen(f.mirrored),)),
        C("rolling-3", "rolling shutter, 3 px a frame", (s.seen(f.rolling_shutter(3.0)),)),
        C("shear-1", "shear of 1 %", (s.seen(f.sheared(0.01)),)),
        C("pinhole", "a lens with distortion fitted as pinhole", model="pinhole"),
        C("lens-1-exact", "lens given 1 % wrong as exact", (s.lens_given(focal=0.01),)),
        C("lens-0.2-exact", "lens given 0.2 % wrong as exact", (s.lens_given(focal=0.002),)),
        C("centre-1-exact", "principal point given 1 px off as exact", (s.lens_given(shift=1.0),)),
    ]  # fmt: skip


def of_the_arm() -> list[Condition]:
    """Errors that are smooth over joints and places: alike in neighbouring views, and none that noise levels hold."""
    good, poor, within = robot.links(0.1, 0.04), robot.links(0.5, 0.05), robot.links(0.5, 0.05, within=True)
    quiet, beside = replace(USUAL, **REPEATS), replace(BESIDE, **REPEATS)
    long = replace(quiet, photos=replace(USUAL.photos, views=(60, 80)))
    arms = [
        ("links-0.1", "links 0.1 mm, joints 0.04 deg", good, quiet),
        ("links-0.1-many", "the same, 60 to 80 poses", good, long),
        ("links-0.5", "links 0.5 mm, joints 0.05 deg", poor, quiet),
        ("links-0.5-many", "the same, 60 to 80 poses", poor, long),
        ("links-0.5-within", "the same, base and flange excepted", within, quiet),
        ("links-0.5-beside", "links 0.5 mm, camera beside", poor, beside),
        ("offsets", "zeros of joints 2 to 5 off by 0.1 deg", robot.offsets(0.1), quiet),
        ("eccentric", "joints err by a sine of 0.02 deg", robot.eccentric(0.02), quiet),
        ("sag", "shoulder and elbow sag by 0.05 deg", robot.sag(0.05), quiet),
        ("backlash", "play of 0.06 deg", robot.backlash(0.06), quiet),
    ]
    edits = [s.arm(fault, average="within" not in name) for name, _, fault, _ in arms]
    alone = [Condition(name, words, (edit,), draw) for (name, words, _, draw), edit in zip(arms, edits)]
    told = [
        replace(c, name=f"told-{c.name}", words=f"{c.words}; accuracy told", edits=(*c.edits, accuracy), told=True)
        for c in alone
    ]
    return alone + told


def of_the_poses() -> list[Condition]:
    C = Condition
    quiet, beside = replace(USUAL, **REPEATS), replace(BESIDE, **REPEATS)
    links = s.arm(robot.links(0.5, 0.05), average=True)
    mixed = (s.arm(robot.links(0.1, 0.04), average=True), s.seen(f.bent(0.3)), s.seen(f.shared_noise(1.0, 1.0)))
    return [
        C("links-and-noise", "links 0.1 mm, noise shared, board bent 0.3 mm", mixed, quiet),
        C("drift-1", "stand drifts by 1 mm, 0.05 deg", (s.drift(1.0, 0.05),), quiet),
        C("walk-1", "stand wanders by 1 mm, 0.05 deg", (s.drift(1.0, 0.05, walk=True),), quiet),
        C("drift-1-beside", "stand drifts, camera beside", (s.drift(1.0, 0.05),), beside),
        C("late-30", "poses 30 ms late at 0.1 m/s, 10 deg/s", (s.late(0.03),), quiet),
        C("late-30-beside", "the same, camera beside", (s.late(0.03),), beside),
        C("nudged", "board pushed by 2 mm half way", (s.nudged(2.0),)),
        C("nudged-beside", "camera beside pushed by 2 mm half way", (s.nudged(2.0),), BESIDE),
        C("misnumbered", "one view numbered from the next column", (s.seen(f.misnumbered),)),
        C("pairs-links-0.5", "links 0.5 mm, target poses", (links, s.measured_pairs(0.1, 0.02)), quiet),
        C("pairs-wrong-30", "30 % of the poses wrong, target poses", (s.wrong_poses(0.3), s.measured_pairs(0.1, 0.02))),
        C("wrong-5", "5 % of the poses wrong", (s.wrong_poses(0.05),)),
        C("wrong-10", "10 % of the poses wrong", (s.wrong_poses(0.10),)),
        C("wrong-30", "30 % of the poses wrong", (s.wrong_poses(0.30),)),
        C("wrong-50", "half of the poses wrong", (s.wrong_poses(0.50),)),
        C("stale", "10 % of the poses that of the view before", (s.stale_poses(0.10),)),
        C("shifted", "every picture with the pose before", (s.shifted_by_one,)),
        C("shifted-beside", "the same, camera beside", (s.shifted_by_one,), BESIDE),
        C("track-drift", "a camera's track that drifts", (s.track(0.1, 0.02, drift=1.0),)),
        C("track-scale", "a camera's track, 5 % too long", (s.track(0.1, 0.02, drift=0.0, scale=1.05),)),
    ]


def accuracy(session: Session) -> None:
    """The robot's accuracy as measured over its work: how far flanges are off, rms over three axes, metres."""
    session.options["robot_accuracy"] = session.off


def conditions() -> list[Condition]:
    """Conditions by name, "hand-eye/…"."""
    return [replace(c, name=f"hand-eye/{c.name}") for c in of_the_image() + of_the_arm() + of_the_poses()]


@lru_cache(maxsize=1000)
def drawn(seed: int, draw: CellDraw, lens_free: bool) -> tuple[Session, Array]:
    """A session and the least covariance it allows: kept, as conditions share them."""
    session = draw_session(seed, draw)
    return session, least_covariance(session, lens_free=lens_free)


def run(condition: Condition, seed: int) -> Run:
    """One calibration, judged by where the camera is on the flange, or in the base."""
    session, least = deepcopy(drawn(seed, condition.draw, not condition.name.endswith(("given", "exact"))))
    for edit in condition.edits:
        edit(session)
    if session.pairs is not None:
        least = np.full((6, 6), np.nan)
    parent = "gripper" if session.setup != TO_HAND else "base"

    def estimate() -> tuple[cb.CalibrationResult, Array, Array]:
        result = calibrated(session, condition)
        found = result.transform(parent, "camera")
        return result, found.matrix, np.asarray(found.covariance)

    return judged(seed, estimate, lambda found: [step_between(truth, found) for truth in session.truths], least)


def calibrated(session: Session, condition: Condition) -> cb.CalibrationResult:
    """What the person does."""
    options = dict(session.options)
    if session.pairs is not None:
        return cb.calibrate_hand_eye(session.reported, session.pairs, setup=session.setup, **options)
    photos = session.photos
    seen = observed(photos, photos.take())
    poses = cb.RobotPoses.from_matrices(session.reported, ids=[v.id for v in seen.views])
    if session.lens is not None:
        names = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
        lens = cb.Camera.create("brown", dict(zip(names, session.lens.tolist())), image_size=photos.size)
        options["camera"] = lens
    return cb.calibrate_hand_eye(poses, seen, setup=session.setup, model=condition.model, **options)
