"""Are the stated uncertainties of `tool`, `time-offset`, `dynamic` and `next-pose` as large as their errors?

    python benchmarks/robot_side.py                       every part, 300 trials a row
    python benchmarks/robot_side.py touch sight --trials 100

Each trial draws new noise, and a new calibration where one is used. chi2/n is the squared error over the stated
covariance, per degree of freedom: 1 where the covariance tells the truth. Its own standard error comes from the trials.
`inside` is how often the truth lies in the stated 95 % region.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.calibrate.clocks.offset import estimate_time_offset
from calibrant.calibrate.dynamic.problem import WristCamera
from calibrant.calibrate.dynamic.track import DynamicCalibration, DynamicNoise
from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.calibrate.solvers.setup import get_setup
from calibrant.calibrate.tool.self_visibility import SelfVisibility, calibrate_self_visibility, moved_by_camera
from calibrant.calibrate.tool.tip import ToolTip, tip_by_sight, tip_by_touch
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, RobotPoses, View
from calibrant.diagnose.budget.cell import error_budget
from calibrant.diagnose.budget.views import NoiseLevels
from calibrant.diagnose.next_pose.candidates import Wishes, candidates
from calibrant.diagnose.next_pose.plan import information_of, nothing_known, plan_views, point_goal
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3
from calibrant.robots.arms import arm
from calibrant.simulate.cell import SIGMA_ROBOT_DEG, SIGMA_ROBOT_MM, WORKING_DISTANCE, Cell, make_cell, observe_cell
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.scenes import Setup, grid, intrinsics_scene, observe, standard_camera
from calibrant.simulate.truth import chi_square

Array = NDArray[np.float64]
Draw = Callable[[int], "Outcome"]

DOWN = so3.exp([np.pi, 0, 0])
TIP = np.array([0.012, -0.034, 0.151])


@dataclass(frozen=True)
class Outcome:
    """Error (n,) and stated covariance (n, n) of one trial, and the error's size in the row's unit."""

    error: Array
    covariance: Array
    size: float

    @property
    def square(self) -> float:
        return chi_square(self.error, self.covariance)


@dataclass(frozen=True)
class Row:
    """A condition by name, what one trial of it gives, and the unit of its errors."""

    name: str
    draw: Draw
    unit: str


def touch_rows() -> Iterator[Row]:
    for n in (4, 6, 12):
        for mm, deg in ((0.1, 0.0), (0.1, 0.02), (0.5, 0.1)):
            yield Row(f"touch, {n} poses, {mm} mm, {deg} deg", _touch(n, mm, deg), "mm")


def _touch(n: int, mm: float, deg: float) -> Draw:
    def draw(seed: int) -> Outcome:
        rng = np.random.default_rng([seed, 1])
        R = DOWN @ so3.exp(0.6 * rng.uniform(-1, 1, (n, 3)))
        poses = noisy_poses(se3.make(R, [0.5, 0.1, 0.05] - R @ TIP), sigma_mm=mm, sigma_deg=deg, rng=rng)
        found = tip_by_touch(poses)
        return Outcome(found.tip - TIP, found.covariance, 1e3 * float(np.linalg.norm(found.tip - TIP)))

    return draw


def sight_rows() -> Iterator[Row]:
    for n in (3, 5, 12):
        for px in (0.2, 1.0):
            yield Row(f"seen, {n} views, {px} px", _sight(n, px), "mm")


_RESULTS: dict[tuple[int, Setup, int], tuple[CalibrationResult, Cell]] = {}


def _hand_eye(seed: int, setup: Setup, views: int = 12) -> tuple[CalibrationResult, Cell]:
    """A calibration of a simulated cell, camera included, as the command makes it; kept for the rows that share it."""
    key = (seed, setup, views)
    if key not in _RESULTS:
        cell = make_cell(seed, setup=setup, views=views)
        result = calibrate_hand_eye(cell.robot_poses, observe_cell(cell, sigma_px=0.1), setup=setup)
        _RESULTS[key] = (result, cell)
    return _RESULTS[key]


def _sight(n: int, px: float) -> Draw:
    def draw(seed: int) -> Outcome:
        rng = np.random.default_rng([seed, 2])
        result, cell = _hand_eye(seed % 60, "eye-to-hand")
        away = rng.uniform((-0.12, -0.1, 0.4), (0.12, 0.1, 0.7), (n, 3))
        R = DOWN @ so3.exp(0.7 * rng.uniform(-1, 1, (n, 3)))
        true = se3.make(R, se3.apply(cell.X, away) - R @ TIP)
        uv = cell.camera.project(away) + px * rng.standard_normal((n, 2))
        reported = noisy_poses(true, sigma_mm=0.1, sigma_deg=0.02, rng=rng)
        found = _sighted(result, reported, uv)
        return Outcome(found.tip - TIP, found.covariance, 1e3 * float(np.linalg.norm(found.tip - TIP)))

    return draw


def _sighted(result: CalibrationResult, reported: Array, uv: Array) -> ToolTip:
    """As the command does, with the board's size as exact as it is here."""
    place = result.transform("base", "camera")
    budget = error_budget(result, target_sigma=1e-9)
    rows = np.r_[0:6, 12 : 12 + len(result.camera.values)]
    joint = budget.covariance[np.ix_(rows, rows)]
    return tip_by_sight(reported, uv, camera=result.camera, base_camera=place, covariance=joint)


def visibility_rows() -> Iterator[Row]:
    two = np.array([[0.03, 0.002, -0.004], [-0.03, 0.001, -0.004]])
    four = np.vstack([two, [[0.0, 0.02, -0.01], [0.01, -0.02, 0.0]]])
    for name, features in (("two features", two), ("four features", four)):
        for calibrated in (False, True):
            camera = "calibrated camera" if calibrated else "known camera"
            yield Row(f"self-visibility, {name}, {camera}", _visible(features, calibrated), "mm")


def _visible(features: Array, calibrated: bool) -> Draw:
    def draw(seed: int) -> Outcome:
        rng = np.random.default_rng([seed, 3])
        camera = standard_camera()
        given = _calibrated(seed % 60) if calibrated else camera
        T = se3.make(so3.exp([0.5, -0.1, 0.4]) @ so3.exp(0.1 * rng.standard_normal(3)), [-0.06, -0.02, 0.3])
        T_target_gripper = se3.make(so3.exp([0, 0, 0.7]), [0.08, 0.05, 0.0])
        points = grid(9, 6, 0.012)
        seen = camera.project(se3.apply(T, points)) + 0.1 * rng.standard_normal((54, 2))
        uv = camera.project(se3.apply(T @ T_target_gripper, features))
        uv = uv + 0.5 * rng.standard_normal(uv.shape)
        answer = _seen_itself(given, View("0", points, seen, np.arange(54)), uv, features)
        truth = se3.inverse(T @ T_target_gripper)
        found = answer.gripper_camera
        e = se3.local(found.matrix, truth)
        return Outcome(e, found.covariance, 1e3 * float(np.linalg.norm(e[3:])))

    return draw


def _seen_itself(given: Camera, view: View, uv: Array, features: Array) -> SelfVisibility:
    """As the command does."""
    found = target_poses(given, [view])
    variance = float(found.rms_px[0] ** 2) * len(view) / (2 * len(view) - 6)
    T = found.T_camera_target[0]
    return calibrate_self_visibility(
        given, T, uv, features, sigma_px=0.5,
        covariance_target=variance * found.covariance[0], target_by_camera=moved_by_camera(given, view, T),
    )  # fmt: skip


_CAMERAS: dict[int, Camera] = {}


def _calibrated(seed: int) -> Camera:
    """The standard camera as 15 views of a board know it."""
    if seed not in _CAMERAS:
        _CAMERAS[seed] = calibrate_intrinsics(intrinsics_scene(15, seed=seed).observations).camera
    return _CAMERAS[seed]


def clock_rows() -> Iterator[Row]:
    for robot, camera in ((500, 30), (125, 30), (125, 60), (50, 30), (25, 60), (20, 10)):
        yield Row(f"time-offset, {robot} Hz, camera {camera} Hz", _clocks(robot, camera), "ms")
    yield Row("time-offset, 125 Hz, camera 30 Hz, ten times the noise", _clocks(125, 30, noise=10), "ms")
    yield Row("time-offset, 125 Hz, camera 30 Hz, exact robot", _clocks(125, 30, robot_noise=0), "ms")
    yield Row("time-offset, 125 Hz, camera 30 Hz, eye-to-hand", _clocks(125, 30, setup="eye-to-hand"), "ms")
    yield Row("time-offset, 125 Hz, camera 30 Hz, slow motion", _clocks(125, 30, speed=0.2), "ms")


def _clocks(
    robot: float, camera: float, *, noise: float = 1.0, robot_noise: float = 1.0, speed: float = 1.0,
    setup: str = "eye-in-hand",
) -> Draw:  # fmt: skip
    X = se3.exp([0.3, -0.2, 0.5, 0.03, -0.05, 0.1])
    Z = se3.exp([2.9, 0.1, 0.2, 0.6, 0.1, 0.0])

    def draw(seed: int) -> Outcome:
        rng = np.random.default_rng([seed, 4])
        motion = Sweep.random(rng, speed)
        t = np.arange(-1.0, 11.0, 1 / robot) + rng.uniform(0, 1 / robot)
        seen = np.arange(0.5, 9.5, 1 / camera) + rng.uniform(0, 1 / camera)
        offset = rng.uniform(-0.3, 0.3)
        A = motion.pose(seen)
        B = se3.inverse(X) @ se3.inverse(A if setup == "eye-in-hand" else se3.inverse(A)) @ Z
        # A camera's pose: half a millimetre along the sight, a fifth of that across, tenths of degrees.
        own = np.array([0.05, 0.05, 0.01, 0, 0, 0]) * np.pi / 180 + np.array([0, 0, 0, 1e-4, 1e-4, 5e-4])
        B = se3.retract(B, noise * own * rng.standard_normal((len(B), 6)))
        level = noise * robot_noise
        reported = noisy_poses(motion.pose(t), sigma_mm=0.1 * level, sigma_deg=0.01 * level, rng=rng)
        found = estimate_time_offset(t, reported, seen - offset, B, setup=setup)
        e = found.offset - offset
        return Outcome(np.array([e]), np.array([[found.sigma**2]]), 1e3 * abs(e))

    return draw


@dataclass(frozen=True)
class Sweep:
    """A smooth motion about all axes: sums of sines, up to about a radian and half a metre a second at speed 1."""

    amplitude: Array
    frequency: Array
    phase: Array

    @classmethod
    def random(cls, rng: np.random.Generator, speed: float) -> Sweep:
        amplitude = np.repeat([[0.4], [0.12]], [3, 3], axis=0) * rng.uniform(0.6, 1.2, (6, 2))
        return cls(amplitude, speed * rng.uniform(0.5, 2.0, (6, 2)), rng.uniform(0, 2 * np.pi, (6, 2)))

    def pose(self, t: Array) -> Array:
        w = np.sum(self.amplitude * np.sin(self.frequency * t[:, None, None] + self.phase), axis=-1)
        return se3.make(so3.exp(w[:, :3]), w[:, 3:] + [0.5, 0.0, 0.4])


def dynamic_rows() -> Iterator[Row]:
    for near, far in ((1, 1), (4, 2)):
        yield Row(f"dynamic, {near} wrist and {far} external views", _dynamic(near, far), "mm")
    yield Row("dynamic, the board in 3 places", _dynamic(1, 1, places=3), "mm")


def _dynamic(near: int, far: int, *, places: int = 1) -> Draw:
    px, robot = 0.1, (SIGMA_ROBOT_MM, SIGMA_ROBOT_DEG)
    noise = DynamicNoise(px, px, np.deg2rad(robot[1]), 1e-3 * robot[0])

    def draw(seed: int) -> Outcome:
        rng = np.random.default_rng([seed, 5])
        result, cell = _hand_eye(seed % 60, "eye-in-hand", 12)
        budget = error_budget(result, target_sigma=1e-9)
        rows = np.r_[0:6, 12 : 12 + len(result.camera.values)]
        wrist = WristCamera(result.camera, budget.X, budget.covariance[np.ix_(rows, rows)])
        external = _calibrated(seed % 60)
        place = cell.Z @ se3.inverse(se3.make(so3.exp([0.5, 0.2, 0.3]), [-0.1, -0.05, 0.7]))
        known = DynamicCalibration(wrist, external, noise)
        points = cell.target.points

        def seen(name: str, T: Array) -> View:
            uv = cell.camera.project(se3.apply(T, points))
            return View(name, points, uv + px * rng.standard_normal(uv.shape), np.arange(len(uv)))

        for k in range(places):
            Z = cell.Z @ se3.make(so3.exp(0.2 * rng.standard_normal(3)), 0.03 * rng.standard_normal(3)) if k else cell.Z
            known = known.target_moved() if k else known
            for i in range(near):
                B = cell.T_camera_target[(seed + i) % len(cell.T_camera_target)]
                A = Z @ se3.inverse(B) @ se3.inverse(cell.X)
                reported = noisy_poses(A[None], sigma_mm=robot[0], sigma_deg=robot[1], rng=rng)[0]
                known = known.seen_by_wrist(seen(f"w{k}{i}", B), reported)
            for i in range(far):
                known = known.seen_by_external(seen(f"e{k}{i}", se3.inverse(place) @ Z))
        found = known.T_base_external
        e = se3.local(found.matrix, place)
        return Outcome(e, np.asarray(found.covariance), 1e3 * float(np.linalg.norm(e[3:])))

    return draw


def plan_rows() -> Iterator[Row]:
    setups: tuple[Setup, ...] = ("eye-in-hand", "eye-to-hand")
    for setup in setups:
        for count in (4, 8):
            name = f"next-pose, {setup}, {count} planned"
            yield Row(f"{name}, predicted", _plan(setup, count, predicted=True), "mm")
            yield Row(f"{name}, calibrated", _plan(setup, count, predicted=False), "mm")


def _plan(setup: Setup, count: int, *, predicted: bool) -> Draw:
    """The error of a point in front of the camera after calibrating from a plan, against what the plan said, or what
    the calibration says."""

    def draw(seed: int) -> Outcome:
        rng = np.random.default_rng([seed, 6])
        cell = make_cell(seed, setup=setup, views=3)
        noise = NoiseLevels(0.1, float(np.deg2rad(SIGMA_ROBOT_DEG)), 1e-3 * SIGMA_ROBOT_MM)
        known = nothing_known(get_setup(setup), cell.X, cell.Z, cell.camera, noise)
        pool = candidates(
            arm("ur5e"), cell.camera, cell.target.points, setup=known.setup, X=cell.X, Z=cell.Z, rng=rng,
            wishes=Wishes(WORKING_DISTANCE), count=100,
        )  # fmt: skip
        goal = point_goal(known, np.array([0.0, 0.0, 0.45]))
        plan = plan_views(known, goal, cell.target.points, pool, count)
        views = observe(cell.camera, cell.target.points, plan.chosen.T_camera_target, sigma_px=0.1, rng=rng)
        reported = noisy_poses(plan.chosen.T_base_gripper, sigma_mm=SIGMA_ROBOT_MM, sigma_deg=SIGMA_ROBOT_DEG, rng=rng)
        poses = RobotPoses.from_matrices(reported, ids=[v.id for v in views.views])
        result = calibrate_hand_eye(poses, views, setup=setup, camera=cell.camera)
        estimate = result.transform(*known.setup.camera_transform.split("_")[1:])
        p = np.array([0.0, 0.0, 0.45])
        e = se3.apply(estimate.matrix, p) - se3.apply(cell.X, p)
        J = goal.J[0]
        if predicted:
            H = known.information + information_of(known, cell.target.points, plan.chosen).sum(axis=0)
            C = J[:, known.free] @ np.linalg.inv(H) @ J[:, known.free].T
        else:
            C = J[:, :6] @ np.asarray(estimate.covariance) @ J[:, :6].T
        return Outcome(e, C, 1e3 * float(np.linalg.norm(e)))

    return draw


PARTS: dict[str, Callable[[], Iterator[Row]]] = {
    "touch": touch_rows,
    "sight": sight_rows,
    "visibility": visibility_rows,
    "clocks": clock_rows,
    "dynamic": dynamic_rows,
    "plans": plan_rows,
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"any of {', '.join(PARTS)}; all by default")
    parser.add_argument("--trials", type=int, default=300)
    parser.add_argument("--only", default="", help="rows whose name contains this")
    given = parser.parse_args()
    print(f"{'condition':56s} trials  refused  rms error      chi2/n        inside", flush=True)
    for part in given.parts or PARTS:
        for row in PARTS[part]():
            if given.only in row.name:
                print(run(row, given.trials), flush=True)
    return 0


def run(row: Row, trials: int) -> str:
    start, refused, found = time.perf_counter(), 0, []
    for seed in range(trials):
        try:
            found.append(row.draw(seed))
        except RefusedError:
            refused += 1
    if not found:
        return f"{row.name:56s} {0:6d} {refused:8d}"
    n = len(found[0].error)
    squares = np.array([o.square for o in found])
    rms = np.sqrt(np.mean([o.size**2 for o in found]))
    inside = np.mean(squares < chi2.ppf(0.95, n))
    deviation = squares.std() / n / np.sqrt(len(squares))
    return (
        f"{row.name:56s} {len(found):6d} {refused:8d}  {rms:7.3f} {row.unit}"
        f"  {squares.mean() / n:6.2f} ± {deviation:.2f}  {100 * inside:5.1f} %  ({time.perf_counter() - start:.0f} s)"
    )


if __name__ == "__main__":
    sys.exit(main())
