"""Dynamic calibration: a camera beside the robot located through a calibrated wrist camera and a target both see (T3).

    wrist view i    T_wrist_target    = X^-1 A_i^-1 B        A_i = T_base_gripper_i, X = T_gripper_wrist
    external view j T_external_target = E^-1 B               B = T_base_target, E = T_base_external

The thesis (document 004, sections 3.2 and 4.5) multiplies E = A X T_wrist_target T_external_target^-1 view by view and
averages. Here X, both cameras' intrinsics, every B and E and the robot's true poses are the unknowns of one weighted
problem over the pixels of all views; the wrist's calibration enters with its joint covariance, the external intrinsics
with theirs, the robot's poses with its noise. An error of the wrist's calibration is therefore not averaged away by
looking again from the same place, and is improved by looking from others.

The share of a noise source in the covariance C of E is what C loses when the source does: d C / d log sigma_k^2, which
sums to C over the sources (C is homogeneous of degree one in all variances, Euler); by central differences.

An estimate is never changed: each view gives a new one, from where the last one stood, in a few steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.calibrate.dynamic import problem as joint
from calibrant.calibrate.dynamic.problem import SOURCES, Sight, WristCamera
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.cameras import Camera
from calibrant.data import TransformEstimate, View
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3
from calibrant.optimize.chances import chi2_tail
from calibrant.optimize.levenberg_marquardt import solve
from calibrant.optimize.solution import Solution

SURPRISING = 1e-4
"""Chance below which a view contradicts what was known: once in ten thousand good views."""
LEAST_POINTS = 6
_STEP = 1e-2
"""Of log sigma: the differences' own error is its square."""


@dataclass(frozen=True)
class DynamicNoise:
    """1 sigma per axis: pixels of both cameras; the robot's poses, radians and metres."""

    wrist_px: float
    external_px: float
    robot_rotation: float
    robot_translation: float

    def __post_init__(self) -> None:
        bad = {name: s for name, s in vars(self).items() if not (np.isfinite(s) and s > 0)}
        if bad:
            raise InputError(f"noise levels must be finite and above 0, got {bad}")


@dataclass(frozen=True)
class Surprise:
    """How well the last view agrees with what was known: by how much it raised the sum of squares, and its chance."""

    view: str
    chi_square: float
    freedom: int

    @property
    def chance(self) -> float:
        """Probability of as much disagreement from the noise alone."""
        return chi2_tail(self.freedom, max(self.chi_square, 0.0))

    @property
    def surprising(self) -> bool:
        """The view contradicts the others: something moved, or the noise is larger than stated."""
        return self.chance < SURPRISING


@dataclass(frozen=True, eq=False)
class DynamicCalibration:
    """What is known after the views so far; every method returns a new one.

    wrist, external: the cameras as they were calibrated. sights: the views taken in; robot, targets, places: start
    values (n, 4, 4) of the robot's poses, T_base_target of each placement of the target, T_base_external of each place
    of the external camera. waiting: external views of a target that the wrist camera has not seen yet. last: about the
    last view.
    """

    wrist: WristCamera
    external: Camera
    noise: DynamicNoise
    sights: tuple[Sight, ...] = ()
    robot: tuple[Array, ...] = ()
    targets: tuple[Array, ...] = ()
    places: tuple[Array, ...] = ()
    waiting: tuple[View, ...] = ()
    new_target: bool = True
    new_place: bool = True
    last: Surprise | None = None
    solution: Solution | None = field(default=None, repr=False)

    def seen_by_wrist(self, view: View, T_base_gripper: ArrayLike) -> DynamicCalibration:
        """After a view of the wrist camera from a robot pose (4, 4).

        Raises: InputError for too few points, a matrix that is not rigid; RefusedError for points behind the camera.
        """
        A = se3.check(T_base_gripper, name="T_base_gripper")
        _check_points(view)
        targets = self.targets
        if self.new_target:
            camera = joint.fitted_camera(self.wrist.camera, self.solution, joint.WRIST)
            X = self.wrist.T_gripper_camera if self.solution is None else self.solution.value(joint.MOUNTING)[0]
            targets = (*targets, A @ X @ target_poses(camera, [view]).T_camera_target[0])
        sight = Sight(view, len(targets) - 1, robot=len(self.robot))
        grown = replace(self, targets=targets, robot=(*self.robot, A), waiting=())
        done = replace(grown._with(sight, fresh=self.new_target), new_target=False)
        for late in self.waiting:
            done = done.seen_by_external(late)
        return done

    def seen_by_external(self, view: View) -> DynamicCalibration:
        """After a view of the external camera; it waits until the wrist camera has seen the target where it lies."""
        _check_points(view)
        if self.new_target:
            return replace(self, waiting=(*self.waiting, view))
        places = self.places
        if self.new_place:
            camera = joint.fitted_camera(self.external, self.solution, joint.EXTERNAL)
            B = self._value(joint.TARGET, self.targets)
            places = (*places, B @ se3.inverse(target_poses(camera, [view]).T_camera_target[0]))
        sight = Sight(view, len(self.targets) - 1, place=len(places) - 1)
        return replace(replace(self, places=places)._with(sight, fresh=self.new_place), new_place=False)

    def target_moved(self) -> DynamicCalibration:
        """The target lies somewhere else from now on; everything else stays known."""
        return replace(self, new_target=True, waiting=())

    def external_moved(self) -> DynamicCalibration:
        """The external camera was moved: its place is open again; what was learnt of its intrinsics stays."""
        return replace(self, new_place=True, waiting=())

    @property
    def located(self) -> bool:
        """Whether both cameras have seen the target with the external camera where it is now."""
        return not self.new_place

    @property
    def T_base_external(self) -> TransformEstimate:
        """Where the external camera is, with its covariance. Raises: RefusedError before both cameras have looked."""
        solution = self._located()
        k = len(self.places) - 1
        return TransformEstimate(
            "base", "external", solution.value(joint.PLACE)[k], solution.covariance(joint.PLACE, k)
        )

    @property
    def camera(self) -> Camera:
        """The external camera with what the views taught of it."""
        return joint.fitted_camera(self.external, self._located(), joint.EXTERNAL)

    @cached_property
    def contributions(self) -> Mapping[str, Array]:
        """Covariance (6, 6) of T_base_external by source; they sum to its covariance. See the module."""
        solution, k = self._located(), len(self.places) - 1
        out = {}
        for source in SOURCES:
            if not any(group in solution.sigmas for group in joint.GROUPS_OF[source]):
                out[source] = np.zeros((6, 6))
                continue
            up, down = (_reweighed(solution, source, s).covariance(joint.PLACE, k) for s in (_STEP, -_STEP))
            out[source] = (up - down) / (4 * _STEP)
        return out

    @property
    def shares(self) -> dict[str, float]:
        """Part of each source in the variance of the external camera's position; they sum to 1."""
        parts = {name: float(np.trace(C[3:, 3:])) for name, C in self.contributions.items()}
        total = sum(parts.values())
        return {name: part / total for name, part in parts.items()}

    def _with(self, sight: Sight, *, fresh: bool) -> DynamicCalibration:
        """The problem with one more view, solved from where the last one stood."""
        sights = (*self.sights, sight)
        problem = joint.problem_of(
            self.wrist, self.external, sights, np.array(self.robot), np.array(self.targets), np.array(self.places),
            levels=self._levels(),
        )  # fmt: skip
        solution = solve(problem, start=joint.start_of(problem, self.solution))
        if solution.unobservable:
            raise RefusedError(f"view {sight.view.id!r}: " + "; ".join(u.message for u in solution.unobservable[:3]))
        before = 0.0 if self.solution is None else self.solution.cost
        last = Surprise(sight.view.id, 2 * (solution.cost - before), 2 * len(sight.view) - (6 if fresh else 0))
        return replace(self, sights=sights, solution=solution, last=last)

    def _levels(self) -> dict[str, float]:
        n = self.noise
        return joint.levels(n.wrist_px, n.external_px, n.robot_rotation, n.robot_translation)

    def _value(self, name: str, start: tuple[Array, ...]) -> Array:
        """The last instance of a variable, as solved, or as it starts."""
        return start[-1] if self.solution is None else np.asarray(self.solution.value(name)[len(start) - 1])

    def _located(self) -> Solution:
        if self.solution is None or self.new_place:
            missing = "wrist" if self.new_target else "external"
            raise RefusedError(f"the {missing} camera has not seen the target yet; nothing is known of the place")
        return self.solution


def _check_points(view: View) -> None:
    if len(view) < LEAST_POINTS:
        raise InputError(f"view {view.id!r} has {len(view)} points; {LEAST_POINTS} are needed to locate a target")


def _reweighed(solution: Solution, source: str, step: float) -> Solution:
    """The same solution with log sigma of a source moved: the values stay, the covariance changes."""
    after = dict(solution.sigmas)
    for group in joint.GROUPS_OF[source]:
        if group in after:
            after[group] *= float(np.exp(step))
    equations = solution.problem.reweigh(solution.equations, solution.values, dict(solution.sigmas), after)
    return replace(solution, sigmas=after, equations=equations)
