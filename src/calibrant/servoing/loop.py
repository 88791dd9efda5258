"""The servo loop: look, decide, move, until what remains is told to be small at rest; or say by name why not.

Far away the arm moves on while pictures are taken. Once what remains is within reach of the tolerance it stands still
and pictures are averaged: motion, blur and latency have no part in the answer. It ends when the mean and three sigmas
are within the tolerance; where the mean is too far it is corrected, where sigma is too large more pictures are taken.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cancel import checkpoint
from calibrant.data import Robot
from calibrant.errors import InputError, RefusedError
from calibrant.servoing.laws.law import Law
from calibrant.servoing.motion import Speeds, Step, recentred, step_of
from calibrant.servoing.sight.eye import Eye, filled
from calibrant.servoing.sight.features import CERTAIN, Features, Remaining, averaged, remaining, shared

SETTLE_S = 0.2
"""At rest before pictures are averaged: arms swing for a tenth of a second or two."""
AT_REST = 3.0
"""Tolerances from which the arm is stopped and looks at rest."""
SURE = 0.5
"""Of the tolerance: where three sigmas are below it and the mean is not within, it is corrected; before, moving adds
noise."""
MOST_CORRECTIONS = 20
"""At rest: one halves what remains and more, so that as many without an end are something else than noise."""
AGAIN_S, SELF_SPEED = 3.0, 0.3
"""An arm that moved within itself and is at a range's end again within seconds gains nothing by it."""
LEAST_AT_REST = 3
"""Pictures of a mean: one alone may be smeared by the arm's swinging."""


@dataclass(frozen=True)
class ServoOptions:
    """tolerance_mm, tolerance_deg: what may remain at rest, with 99 % chance; gain: 1/s far away, and near_gain where
    little remains; period_s: of one motion; patience: pictures without the target before it is lost; stall_s: time
    without progress; longest_s: in all; rest_pictures: most that are averaged at rest; speeds of the camera."""

    tolerance_mm: float = 0.3
    tolerance_deg: float = 0.1
    gain: float = 1.2
    near_gain: float = 2.5
    period_s: float = 0.1
    patience: int = 5
    stall_s: float = 4.0
    longest_s: float = 90.0
    rest_pictures: int = 100
    speeds: Speeds = field(default_factory=Speeds)

    def __post_init__(self) -> None:
        bad = {n: v for n, v in vars(self).items() if not isinstance(v, Speeds) and not (np.isfinite(v) and v > 0)}
        if bad:
            raise InputError(f"servoing needs finite figures above 0, got {bad}")
        fastest = 1.0 / self.period_s
        if max(self.gain, self.near_gain) >= fastest:
            raise InputError(
                f"a gain of {max(self.gain, self.near_gain):g} 1/s overshoots with motions of {self.period_s:g} s; at "
                f"most {fastest:g} 1/s"
            )


@dataclass(frozen=True, eq=False)
class Sample:
    """One picture of a run: when, at rest or not; error_px: rms of the features per axis; what remained, mm and deg,
    with 1 sigma; the gain; the camera's twist (6,); what held it back; the arm's smallest singular value."""

    time_s: float
    resting: bool
    error_px: float
    mm: float
    deg: float
    sigma_mm: float
    sigma_deg: float
    gain: float
    twist: Array
    bounds: tuple[str, ...]
    manipulability: float


@dataclass(frozen=True, eq=False)
class ServoRun:
    """What a run did. samples: picture by picture; last: what remained at rest; T_base_gripper at the end; pictures
    taken; seconds on the robot's clock; whole: what remains of all six degrees of freedom."""

    samples: tuple[Sample, ...]
    last: Remaining
    T_base_gripper: Array
    pictures: int
    seconds: float
    whole: Remaining


Heard = Callable[[Sample], None]


def _silent(sample: Sample) -> None:
    """Nobody listens."""


def servo(
    robot: Robot,
    eye: Eye,
    wanted: Features,
    law: Law,
    *,
    options: ServoOptions | None = None,
    heard: Heard = _silent,
) -> ServoRun:
    """Lead the arm until the camera sees the features where they are wanted.

    heard: called after every picture. The robot stands when this returns or raises.
    Raises: RefusedError when the target is out of view, or no further progress is made: by which joint, border or
    singular pose; or the features cannot tell the tolerance; DeviceError when robot or camera do not answer.
    """
    state = _Loop(robot, eye, wanted, law, options or ServoOptions(), heard)
    try:
        return state.run()
    finally:
        robot.stop()


@dataclass(eq=False)
class _Loop:
    """A run under way: it grows while the arm moves."""

    robot: Robot
    eye: Eye
    wanted: Features
    law: Law
    options: ServoOptions
    heard: Heard
    samples: list[Sample] = field(default_factory=list)
    pictures: int = 0
    best: float = inf
    best_at: float = 0.0
    corrections: int = 0
    before: Features | None = None
    whole: bool = True
    gave_way_at: float | None = None

    def run(self) -> ServoRun:
        if len(self.wanted) < self.law.least:
            raise InputError(
                f"--control {self.law.name} needs {self.law.least} features, {len(self.wanted)} were taught"
            )
        start = self.best_at = self.robot.time_s
        while True:
            checkpoint()
            seen, wanted = self._looked()
            left = remaining(seen, wanted, self.law.subspace(self._gripper_in_camera()))
            lost_in_noise = left.mm <= CERTAIN * left.sigma_mm and left.deg <= CERTAIN * left.sigma_deg
            if lost_in_noise or self._tolerances(left) <= AT_REST:
                done = self._at_rest(start)
                if done is not None:
                    return done
                continue
            self._check_progress(left, start)
            self._move(seen, wanted, left, self._gain(left, wanted), resting=False)

    def _at_rest(self, start: float) -> ServoRun | None:
        """The end of the run, or None after a motion. Raises: RefusedError where sigma stays too large."""
        self.robot.stop()
        self.robot.wait(SETTLE_S)
        several: list[Features] = []
        while True:
            checkpoint()
            several.append(self._looked()[0])
            seen, wanted = shared(averaged(several), self.wanted, least=self.law.least)
            left = remaining(seen, wanted, self.law.subspace(self._gripper_in_camera()))
            if len(several) < LEAST_AT_REST:
                continue
            inside, sure, far = self._told(left)
            if inside:
                self._noted(seen, wanted, left, 0.0, None, resting=True)
                return ServoRun(
                    tuple(self.samples), left, self.robot.pose(), self.pictures, self.robot.time_s - start,
                    remaining(seen, wanted, np.eye(6)),
                )  # fmt: skip
            if far or sure or len(several) >= self.options.rest_pictures:
                self._check_certain(left, len(several))
                self.corrections += 1
                if self.corrections > MOST_CORRECTIONS:
                    self._refuse(left, f"{MOST_CORRECTIONS} corrections at rest brought it no nearer")
                self._move(seen, wanted, left, 0.8 / self.options.period_s, resting=True)
                return None

    def _told(self, left: Remaining) -> tuple[bool, bool, bool]:
        """Whether what remains is within the tolerance, is known well enough to correct it, is far beyond its noise."""
        mm, deg = self.options.tolerance_mm, self.options.tolerance_deg
        inside = left.within_99_mm <= mm and left.within_99_deg <= deg
        sure = CERTAIN * left.sigma_mm <= SURE * mm and CERTAIN * left.sigma_deg <= SURE * deg
        far = left.mm > max(CERTAIN * left.sigma_mm, mm) or left.deg > max(CERTAIN * left.sigma_deg, deg)
        return inside, sure, far

    def _move(self, seen: Features, wanted: Features, left: Remaining, gain: float, *, resting: bool) -> None:
        pull = self.law.pull(seen, wanted, self._gripper_in_camera())
        keep = seen if self.whole else seen.only(_inner(seen))
        step = step_of(
            self.robot, self.eye.mounting, self.eye.camera, pull, seen, keep, gain=gain, speeds=self.options.speeds
        )
        self._noted(seen, wanted, left, gain, step, resting)
        if any("range" in words for words in step.bounds) and self._gave_way():
            return
        try:
            self.robot.drive(step.flange, seconds=self.options.period_s)
        except RefusedError:
            if not self._gave_way():
                raise

    def _gave_way(self) -> bool:
        """An arm with a joint to spare moves within itself, away from the ends of its ranges; whether it did, once."""
        if self.gave_way_at is not None and self.robot.time_s - self.gave_way_at < AGAIN_S:
            return False
        self.gave_way_at = self.robot.time_s
        self.robot.stop()
        joints = recentred(self.robot, self.robot.joints())
        if joints is None:
            return False
        self.robot.move_joints(joints, speed=SELF_SPEED)
        self.best_at = self.robot.time_s
        return True

    def _looked(self) -> tuple[Features, Features]:
        """The features of the next picture that shows them. Raises: RefusedError after `patience` that do not."""
        why = ""
        for _ in range(self.options.patience):
            found = self.eye.look(self.before)
            self.pictures += 1
            if not isinstance(found, str):
                self.before = filled(found, self.wanted)
                self.whole = self.eye.model is None or len(found) == len(self.eye.model.ids)
                try:
                    return shared(self.before, self.wanted, least=self.law.least)
                except RefusedError as error:
                    found = str(error)
            why = found
            self.robot.stop()
            self.robot.wait(self.options.period_s)
            self.before = None
        moved = f" after {len(self.samples)} pictures" if self.samples else ""
        raise RefusedError(
            f"the target is out of view{moved}: {why}. The robot stands; lead it by hand to where camera "
            f"{self.eye.source.name} sees the whole target, and start again"
        )

    def _gripper_in_camera(self) -> Array:
        T = self.robot.pose()
        return self.eye.mounting.T_base_camera(T)[:3, :3].T @ T[:3, :3]

    def _tolerances(self, left: Remaining) -> float:
        return max(left.mm / self.options.tolerance_mm, left.deg / self.options.tolerance_deg)

    def _gain(self, left: Remaining, wanted: Features) -> float:
        """Low where much remains, high where little does (Kermorgant and Chaumette 2014): a e^(-b x) + c."""
        size = float(np.linalg.norm(left.delta[3:]) / wanted.middle_depth + np.linalg.norm(left.delta[:3]))
        near, far = self.options.near_gain, self.options.gain
        return far + (near - far) * float(np.exp(-10.0 * size))

    def _check_certain(self, left: Remaining, pictures: int) -> None:
        """Raises: RefusedError where as many pictures as may be averaged leave sigma above the tolerance."""
        asked = self.options
        if pictures < asked.rest_pictures:
            return
        if CERTAIN * left.sigma_mm > asked.tolerance_mm or CERTAIN * left.sigma_deg > asked.tolerance_deg:
            raise RefusedError(
                f"the tolerance cannot be met: {asked.tolerance_mm:g} mm and {asked.tolerance_deg:g} deg are asked for "
                f"and after {pictures} pictures at rest {_words(left)} remain (1 sigma): allow more, teach by more "
                "pictures, come nearer, or use a larger target"
            )

    def _check_progress(self, left: Remaining, start: float) -> None:
        """Raises: RefusedError for a run that gets no nearer, by what holds it."""
        now, within = self.robot.time_s, self._tolerances(left)
        if within < 0.98 * self.best:
            self.best, self.best_at = within, now
        if now - self.best_at < self.options.stall_s and now - start < self.options.longest_s:
            return
        self._refuse(left, f"no nearer for {now - self.best_at:.1f} s")

    def _refuse(self, left: Remaining, said: str) -> NoReturn:
        """Raises: RefusedError with what remains and what held the arm."""
        held = [w for s in self.samples[-10:] for w in s.bounds]
        why = max(set(held), key=held.count) if held else ""
        reason = f"{why} holds the arm" if why else "the arm's motions do not bring the features nearer"
        todo = "Is the camera's calibration that of this camera, and does the target stand still?"
        if why:
            todo = "The wanted pose may be out of reach from here: start from another side, or teach another pose."
        raise RefusedError(f"{said}: {_words(left)} remain, and {reason}. {todo}")

    def _noted(
        self, seen: Features, wanted: Features, left: Remaining, gain: float, step: Step | None, resting: bool
    ) -> None:
        error = float(np.sqrt(np.mean((seen.uv - wanted.uv) ** 2)))
        twist = np.zeros(6) if step is None else step.camera
        sample = Sample(
            seen.time_s, resting, error, left.mm, left.deg, left.sigma_mm, left.sigma_deg, gain, twist,
            () if step is None else step.bounds, float("nan") if step is None else step.manipulability,
        )  # fmt: skip
        self.samples.append(sample)
        self.heard(sample)


def _inner(seen: Features) -> NDArray[np.int64]:
    """Ids of the half nearest to the features' middle: of a board that is seen in part, what is to stay in view."""
    away = np.linalg.norm(seen.uv - seen.uv.mean(axis=0), axis=1)
    return seen.ids[np.argsort(away)[: max(len(seen) // 2, 4)]]


def _words(left: Remaining) -> str:
    return f"{left.mm:.3g} ± {left.sigma_mm:.2g} mm and {left.deg:.3g} ± {left.sigma_deg:.2g} deg"
