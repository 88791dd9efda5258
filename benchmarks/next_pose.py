"""How many planned poses do what 15 random ones do, on the demo's simulated arm.

    python benchmarks/next_pose.py [--seeds 50] [--setup eye-in-hand] [--candidates 300]
    python benchmarks/next_pose.py --random 20           as many as the thesis took by hand (sections 4.3.1, 4.4.1)

For each seed a cell is drawn. The plan is made without its truth: from the ordinary mounting, which the cell's own
differs from by 6 degrees and 10 mm along each axis (1 sigma). Both sets of poses are then judged in the true cell: by
the 1 sigma of a workpiece in front of the camera that the joint problem predicts there, and by the error of calibrating
simulated points once.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.calibrate.cell.problem.camera_role import held_camera
from calibrant.calibrate.cell.problem.groups import pixel_group, robot_groups
from calibrant.calibrate.cell.problem.layout import ONLY_ROBOT
from calibrant.calibrate.cell.problem.problem import cell_of_one, cell_problem
from calibrant.calibrate.solvers.setup import get_setup
from calibrant.diagnose.budget.views import NoiseLevels
from calibrant.diagnose.next_pose.candidates import CANDIDATES, Candidates, Wishes, candidates, in_view
from calibrant.diagnose.next_pose.plan import Knowledge, expected, information_of, nothing_known, plan_views, point_goal
from calibrant.geometry import se3
from calibrant.optimize.levenberg_marquardt import solve
from calibrant.robots.arms import arm
from calibrant.simulate.cell import SIGMA_ROBOT_DEG, SIGMA_ROBOT_MM, WORKING_DISTANCE, Cell, make_cell
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.scenes import Setup, observe, standard_mounting, target_poses

Array = NDArray[np.float64]
NOISE = NoiseLevels(0.1, float(np.deg2rad(SIGMA_ROBOT_DEG)), 1e-3 * SIGMA_ROBOT_MM)
RANDOM = 15
LARGEST_PLAN = 12
LEAST_POINTS = 6
"""A view that the true mounting leaves with fewer points is lost to the plan."""


@dataclass(frozen=True)
class Trial:
    """Of one cell: sigma of the random poses, of plans of 3, 4, … poses, and errors of the random ones and of 8, mm."""

    random_mm: float
    planned_mm: tuple[float, ...]
    random_error_mm: float
    planned_error_mm: float

    @property
    def needed(self) -> int:
        """The smallest plan that is as certain as the random poses."""
        reached = [n for n, s in enumerate(self.planned_mm, start=3) if s <= self.random_mm]
        return reached[0] if reached else LARGEST_PLAN + 1


def trial(seed: int, setup: Setup, count: int = CANDIDATES, *, drawn: int = RANDOM) -> Trial:
    """Plan for one cell and judge in its truth, against `drawn` random poses."""
    cell = make_cell(seed, setup=setup, views=drawn)
    X, Z = standard_mounting(setup)
    nominal = nothing_known(get_setup(setup), X, Z, cell.camera, NOISE)
    truth = nothing_known(get_setup(setup), cell.X, cell.Z, cell.camera, NOISE)
    pool = candidates(
        arm("ur5e"), cell.camera, cell.target.points, setup=nominal.setup, X=X, Z=Z,
        rng=np.random.default_rng([seed, 7]), wishes=Wishes(WORKING_DISTANCE), count=count,
    )  # fmt: skip
    random_mm = _sigma(cell, truth, cell.T_base_gripper)
    planned, eight = [], cell.T_base_gripper
    for n in range(3, LARGEST_PLAN + 1):
        plan = plan_views(nominal, point_goal(nominal, cell.workpiece), cell.target.points, pool, n)
        planned.append(_sigma(cell, truth, plan.chosen.T_base_gripper))
        if n == 8:
            eight = plan.chosen.T_base_gripper
    rng = np.random.default_rng([seed, 8])
    return Trial(random_mm, tuple(planned), _error(cell, cell.T_base_gripper, rng), _error(cell, eight, rng))


def _sigma(cell: Cell, truth: Knowledge, T_base_gripper: Array) -> float:
    """1 sigma of the workpiece, worst direction, mm, after poses (n, 4, 4) in the true cell."""
    B = target_poses(cell.setup, cell.X, cell.Z, T_base_gripper)
    visible = in_view(cell.camera, cell.target.points, B)
    seen = visible.sum(axis=1) >= LEAST_POINTS
    views = Candidates(np.zeros((int(seen.sum()), 0)), T_base_gripper[seen], B[seen], visible[seen])
    added = information_of(truth, cell.target.points, views).sum(axis=0)
    return expected(truth.information + added, point_goal(truth, cell.workpiece).J[..., truth.free]).sigma_mm


def _error(cell: Cell, T_base_gripper: Array, rng: np.random.Generator) -> float:
    """Distance, mm, between the workpiece and where one simulated calibration puts it."""
    B = target_poses(cell.setup, cell.X, cell.Z, T_base_gripper)
    enough = in_view(cell.camera, cell.target.points, B).sum(axis=1) >= LEAST_POINTS
    B, T_base_gripper = B[enough], T_base_gripper[enough]
    seen = observe(cell.camera, cell.target.points, B, sigma_px=NOISE.pixel, rng=rng)
    robot = noisy_poses(T_base_gripper, sigma_mm=SIGMA_ROBOT_MM, sigma_deg=SIGMA_ROBOT_DEG, rng=rng)
    levels = dict(zip(robot_groups(ONLY_ROBOT), (NOISE.robot_rotation, NOISE.robot_translation)))
    setup = get_setup(cell.setup)
    one = cell_of_one(setup, robot, seen.views, held_camera(cell.camera))
    problem = cell_problem(one, one.placed(cell.X, cell.Z), {pixel_group("camera"): NOISE.pixel, **levels})
    X = solve(problem).value(setup.camera_transform)[0]
    return float(1e3 * np.linalg.norm(se3.apply(X, cell.workpiece) - se3.apply(cell.X, cell.workpiece)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--setup", choices=["eye-in-hand", "eye-to-hand"], default="eye-in-hand")
    parser.add_argument("--candidates", type=int, default=CANDIDATES)
    parser.add_argument("--random", type=int, default=RANDOM, metavar="POSES", help="how many random poses to beat")
    given = parser.parse_args()
    start = time.perf_counter()
    trials = [trial(seed, given.setup, given.candidates, drawn=given.random) for seed in range(given.seeds)]
    needed = np.array([t.needed for t in trials])
    print(f"{given.setup}, {given.seeds} cells, {given.candidates} candidates, {time.perf_counter() - start:.0f} s")
    print(f"sigma of {given.random} random poses: median {np.median([t.random_mm for t in trials]):.3f} mm")
    for k, n in enumerate(range(3, LARGEST_PLAN + 1)):
        print(f"  {n:2d} planned: median {np.median([t.planned_mm[k] for t in trials]):.3f} mm")
    quartiles = np.percentile(needed, [0, 25, 50, 75, 100])
    print(f"planned poses needed: median {quartiles[2]:.0f}, quartiles {quartiles[1]:.0f} and {quartiles[3]:.0f}, "
          f"from {quartiles[0]:.0f} to {quartiles[4]:.0f}")  # fmt: skip
    rms = [
        np.sqrt(np.mean(np.square([getattr(t, f) for t in trials]))) for f in ("random_error_mm", "planned_error_mm")
    ]
    print(f"RMS error of one calibration each: {given.random} random {rms[0]:.3f} mm, 8 planned {rms[1]:.3f} mm")


if __name__ == "__main__":
    main()
