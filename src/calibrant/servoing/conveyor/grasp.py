"""A grasp on the move: follow what a conveyor carries, come near while it stays in view, close the fingers in passing.

    look      pictures until the filter knows the rate well enough for the time that is left
    follow    the gripper keeps its place before the moving object, at the stand-off
    approach  the stand-off shrinks along the line on which the object stays fixated, feed-forward of its rate, and only
              while the gripper is where it should be
    close     the fingers close while the arm goes on with the object, then both are lifted

    x_flange = rate of the object carried to the flange's origin + gain * (wanted pose - pose)

The camera's last pictures are of the past: the filter carries each estimate to the time at which the motion takes
place, that of the picture less the latency of the stamps. Where the camera sees no more, the prediction leads alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from calibrant.arrays import Array
from calibrant.cancel import checkpoint
from calibrant.data import CameraSource, Picture, Robot
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.geometry.motion import Motion
from calibrant.servoing.conveyor.latency import Latency
from calibrant.servoing.conveyor.tracker import Tracked, Unsteadiness, first_seen, laid_flat
from calibrant.servoing.sight.mounting import Mounting


@dataclass(frozen=True, eq=False)
class Sighting:
    """T_camera_object (4, 4) in one picture, with its covariance (6, 6), `se3.retract`'s chart."""

    T_camera_object: Array
    covariance: Array


class Finder(Protocol):
    """Finds the object in a picture that a camera at T_base_camera (4, 4) took: its pose, or why not."""

    def __call__(self, picture: Picture, T_base_camera: Array) -> Sighting | str:
        """See the class."""
        ...


@dataclass(frozen=True)
class GraspOptions:
    """stand_off_m: how far the approach begins from the grasp, along the gripper's z; open_m, close_m: widths; lift_m;
    gain: 1/s; period_s: of one motion; near_m, near_rad: where the gripper must be for the approach to go on;
    approach_m_s: its speed; patience_s: without a sight before the grasp is given up, arrive_s before the first;
    least_sights: before the arm follows; longest_s: in all; fastest: of the flange; blind_m: of the approach, over
    which the prediction leads alone."""

    stand_off_m: float = 0.12
    open_m: float = 0.078
    close_m: float = 0.0
    lift_m: float = 0.10
    gain: float = 5.0
    period_s: float = 0.04
    near_m: float = 0.006
    near_rad: float = float(np.deg2rad(4.0))
    approach_m_s: float = 0.10
    patience_s: float = 1.0
    arrive_s: float = 20.0
    least_sights: int = 4
    longest_s: float = 30.0
    fastest_m_s: float = 0.6
    fastest_rad_s: float = 2.0
    blind_m: float = 0.05
    unsteadiness: Unsteadiness = field(default_factory=Unsteadiness)

    def __post_init__(self) -> None:
        figures = {n: v for n, v in vars(self).items() if not isinstance(v, Unsteadiness)}
        bad = {n: v for n, v in figures.items() if not (np.isfinite(v) and v >= 0)}
        if bad:
            raise InputError(f"a grasp's figures are finite and 0 or more, got {bad}")


@dataclass(frozen=True, eq=False)
class Grasp:
    """What became of it: held, in words why not; the object as it was predicted at closing, T_object_gripper there and
    its 1 sigma, metres; pictures with and without the object; seconds."""

    held: bool
    reason: str
    object: Tracked
    off_m: float
    sigma_m: float
    sights: int
    pictures: int
    seconds: float


def grasp_moving(
    robot: Robot,
    source: CameraSource,
    mounting: Mounting,
    find: Finder,
    T_object_gripper: Array,
    *,
    normal: Array | None = None,
    latency: Latency | None = None,
    options: GraspOptions | None = None,
    symmetry: int = 1,
    within: Callable[[Array], bool] = lambda T_base_gripper: True,
) -> Grasp:
    """Grasp an object that moves and turns evenly.

    T_object_gripper (4, 4): the flange against the object when the fingers close; normal (3,) of the belt in the base,
    for objects that stay on it, their z along it; latency of the camera's stamps; symmetry: turns about the object's z
    that bring it onto itself, 4 of a cube; within: poses of the flange that are allowed.
    The robot stands when this returns or raises.
    Raises: RefusedError when the object is not seen, lost, or leaves the allowed space before it is grasped;
    DeviceError when robot or camera do not answer.
    """
    state = _Follower(
        robot, source, mounting, find, T_object_gripper, normal, latency or Latency(0.0), options or GraspOptions(),
        symmetry, within,
    )  # fmt: skip
    try:
        return state.run()
    finally:
        robot.stop()


@dataclass(eq=False)
class _Follower:
    """A grasp under way."""

    robot: Robot
    source: CameraSource
    mounting: Mounting
    find: Finder
    T_object_gripper: Array
    normal: Array | None
    latency: Latency
    options: GraspOptions
    symmetry: int
    within: Callable[[Array], bool]
    tracked: Tracked | None = None
    sights: int = 0
    pictures: int = 0
    seen_at: float = 0.0
    why: str = ""
    times: list[float] = field(default_factory=list)
    poses: list[Array] = field(default_factory=list)

    def run(self) -> Grasp:
        began = self.seen_at = self.robot.time_s
        self.robot.grip(self.options.open_m)
        left, on_place, before = self.options.stand_off_m, False, None
        while True:
            checkpoint()
            now = self.robot.time_s
            if now - began > self.options.longest_s:
                raise RefusedError(f"no grasp after {now - began:.0f} s: the gripper did not come near; {self._told()}")
            self._remember()
            blind = left <= self.options.blind_m
            if not blind or self.sights < self.options.least_sights:
                self._look()
            if self.tracked is None or self.sights < self.options.least_sights:
                self._check_seen()
                if not self.sights:
                    self.robot.wait(self.options.period_s)
                continue
            if not blind:
                self._check_seen()
            cycle = min(now - before, 0.2) if before is not None else self.options.period_s
            before = now
            shorter = max(left - self.options.approach_m_s * cycle, 0.0) if on_place else left
            off = self._follow(self.tracked, left, shorter, max(cycle, self.options.period_s))
            on_place = off[0] < self.options.near_m and off[1] < self.options.near_rad
            if on_place and left <= 0:
                return self._closed(self.tracked, began, off[0])
            left = shorter

    def _remember(self) -> None:
        """Where the arm is at what time: pictures are stamped, and belong to where it was then."""
        t = self.robot.time_s
        if self.times and t <= self.times[-1]:
            self.poses[-1] = self.robot.pose()
            return
        self.times.append(t)
        self.poses.append(self.robot.pose())
        del self.times[:-200], self.poses[:-200]

    def _look(self) -> None:
        picture = self.source.take()
        self.pictures += 1
        self._remember()
        t = picture.time_s - self.latency.seconds
        T_base_gripper = Motion(np.array(self.times), np.stack(self.poses)).at([t])[0]
        T_base_camera = self.mounting.T_base_camera(T_base_gripper)
        found = self.find(picture, T_base_camera)
        if isinstance(found, str):
            self.why = found
            return
        R = np.zeros((6, 6))
        R[:3, :3] = R[3:, 3:] = T_base_camera[:3, :3]
        T, C = T_base_camera @ found.T_camera_object, R @ found.covariance @ R.T
        if self.normal is not None:
            T, C = laid_flat(T, C, self.normal)
        T = self._nearest_turn(T, t)
        if self.latency.sigma > 0 and self.tracked is not None:
            late = self.latency.sigma * (self.tracked.rate - self._rate())
            C = C + np.outer(late, late)
        if self.tracked is None or self.tracked.misses > 3:
            self.tracked = first_seen(T, C, t, normal=self.normal, unsteadiness=self.options.unsteadiness)
            self.sights = 0
        else:
            self.tracked = self.tracked.measured(T, C, t)
        self.sights += 1
        self.seen_at = self.robot.time_s

    def _nearest_turn(self, T_base_object: Array, time_s: float) -> Array:
        """Of the poses that look alike, that nearest to where the object should be; at first, to the gripper's turn."""
        if self.symmetry == 1:
            return T_base_object
        turns = so3.exp(2 * np.pi / self.symmetry * np.arange(self.symmetry)[:, None] * np.array([0.0, 0.0, 1.0]))
        alike = T_base_object[:3, :3] @ turns
        if self.tracked is not None:
            expected = self.tracked.at(time_s).T_base_object[:3, :3]
        else:
            expected = (self.robot.pose() @ se3.inverse(self.T_object_gripper))[:3, :3]
        best = int(np.argmin(so3.angle(np.swapaxes(alike, 1, 2) @ expected)))
        return se3.make(alike[best], T_base_object[:3, 3])

    def _rate(self) -> Array:
        """The flange's rate now, by the last two poses."""
        if len(self.times) < 2:
            return np.zeros(6)
        return se3.local(self.poses[-2], self.poses[-1]) / (self.times[-1] - self.times[-2])

    def _check_seen(self) -> None:
        patience = self.options.patience_s if self.sights else self.options.arrive_s
        if self.robot.time_s - self.seen_at > patience:
            raise RefusedError(
                f"the object {'was lost' if self.sights else 'is not seen'}: {self.why or 'no picture shows it'}. "
                "The robot stands; is it on the belt, and before the camera?"
            )

    def _follow(self, tracked: Tracked, left: float, shorter: float, cycle: float) -> tuple[float, float]:
        """One motion towards the place `left` metres short of the grasp, and on to `shorter` in a cycle, seconds; how
        far the flange is from the first, m and rad."""
        here = tracked.at(self.robot.time_s)
        T = self.robot.pose()
        wanted = here.T_base_object @ self._place(left)
        off = se3.local(T, wanted)
        carried = _carried(here.rate, here.T_base_object, wanted)
        if not self.within(wanted):
            raise RefusedError(
                f"the object leaves the space that the arm may work in before it is grasped; {self._told()}"
            )
        onward = se3.local(wanted, here.T_base_object @ self._place(shorter)) / cycle
        rate = carried + onward + self.options.gain * off
        rate = rate / max(
            1.0,
            float(np.linalg.norm(rate[3:])) / self.options.fastest_m_s,
            float(np.linalg.norm(rate[:3])) / self.options.fastest_rad_s,
        )
        self.robot.drive(rate, seconds=self.options.period_s)
        return float(np.linalg.norm(off[3:])), float(np.linalg.norm(off[:3]))

    def _place(self, left: float) -> Array:
        """T_object_gripper `left` metres before the grasp: aside until the last part, so that the object stays where
        the camera looks; of a camera beside the robot straight before it."""
        back = np.eye(4)
        back[2, 3] = -left
        if self.mounting.setup == "eye-in-hand":
            X = self.mounting.transform
            in_camera = se3.apply(se3.inverse(self.T_object_gripper @ X), np.zeros(3))
            aside = X[:3, :3] @ np.array([in_camera[0], in_camera[1], 0.0])
            back[:3, 3] += aside * min(left / max(self.options.blind_m, 1e-6), 1.0)
        return self.T_object_gripper @ back

    def _closed(self, tracked: Tracked, began: float, off_m: float) -> Grasp:
        """The fingers close while the arm keeps the object's rate; then up, and see whether something is held."""
        now = tracked.at(self.robot.time_s)
        self.robot.drive(_carried(now.rate, now.T_base_object, self.robot.pose()), seconds=0.0)
        state = self.robot.grip(self.options.close_m)
        up = np.zeros(6)
        up[5] = 0.15
        if state.holds:
            self.robot.drive(up, seconds=self.options.lift_m / 0.15)
        self.robot.stop()
        sigma = float(np.sqrt(max(np.linalg.eigvalsh(now.covariance[3:6, 3:6])[-1], 0.0)))
        reason = "" if state.holds else "the fingers closed on nothing"
        return Grasp(state.holds, reason, now, off_m, sigma, self.sights, self.pictures, self.robot.time_s - began)

    def _told(self) -> str:
        if self.tracked is None:
            return "the object was not seen"
        v, w = self.tracked.rate[3:], np.rad2deg(np.linalg.norm(self.tracked.rate[:3]))
        return (
            f"it moves at {np.linalg.norm(v):.3f} ± {self.tracked.speed_sigma:.3f} m/s and turns at {w:.1f} deg/s, "
            f"after {self.sights} sights"
        )


def _carried(rate: Array, T_base_object: Array, T_base_gripper: Array) -> Array:
    """The rate of the gripper that goes with an object: omega, v + omega x r."""
    r = T_base_gripper[:3, 3] - T_base_object[:3, 3]
    return np.r_[rate[:3], rate[3:] + np.cross(rate[:3], r)]
