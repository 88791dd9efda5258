"""Does the demo's predicted uncertainty tell the truth? Simulated cells, each compared with its own truth.

    python benchmarks/demo_truth.py                       100 seeds from points with 0.1 px of noise
    python benchmarks/demo_truth.py --render              the same from rendered images, as `calibrant demo` runs
    python benchmarks/demo_truth.py --setup eye-to-hand

For each seed: e = truth - estimate of the camera's transform, C its covariance; e^T C^-1 e must follow chi-square with
6 degrees of freedom. Passes when the truth lies inside the 99 % region in at least 95 of 100.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from scipy.stats import chi2, kstest

from calibrant.errors import CalibrantError
from calibrant.simulate.cell import make_cell, observe_cell
from calibrant.simulate.scenes import Setup
from calibrant.simulate.truth import PointTruth, TransformTruth, point_truth, transform_truth

SIGMA_PX = 0.1
REQUIRED = 0.95


@dataclass(frozen=True, eq=False)
class Trial:
    """One seed: the comparison, or why there is none."""

    seed: int
    seconds: float
    truth: TransformTruth | None = None
    point: PointTruth | None = None
    refused: str = ""


def run_points(seed: int, setup: Setup, views: int) -> tuple[TransformTruth, PointTruth]:
    """From the true projections with noise, as a perfect detector would hand them over."""
    from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye

    cell = make_cell(seed, setup=setup, views=views)
    result = calibrate_hand_eye(cell.robot_poses, observe_cell(cell, sigma_px=SIGMA_PX), setup=setup)
    estimate = result.transform("gripper" if setup == "eye-in-hand" else "base", "camera")
    return transform_truth(estimate, cell.X), point_truth(estimate, cell.X, cell.workpiece)


def run_rendered(seed: int, setup: Setup, views: int) -> tuple[TransformTruth, PointTruth]:
    """From pictures, exactly as the demo does."""
    from calibrant.tasks.demo.chain import run_demo

    with tempfile.TemporaryDirectory() as folder:
        outcome = run_demo(Path(folder) / "demo", seed=seed, views=views, setup=setup)
    return outcome.compared.camera_truth, outcome.compared.tool_point


def run_trial(seed: int, *, setup: Setup, views: int, render: bool) -> Trial:
    """One seed, timed."""
    start = time.perf_counter()
    try:
        truth, point = (run_rendered if render else run_points)(seed, setup, views)
    except CalibrantError as error:
        return Trial(seed, time.perf_counter() - start, refused=str(error))
    return Trial(seed, time.perf_counter() - start, truth, point)


def report(trials: list[Trial]) -> bool:
    """Print the figures; returns whether enough truths lie where they were promised."""
    done = [t for t in trials if t.truth is not None and t.point is not None]
    for trial in trials:
        if trial.refused:
            print(f"seed {trial.seed:3d}  refused: {trial.refused}")
    errors = np.array([t.truth.normalised for t in done])
    inside = sum(t.truth.inside for t in done)
    ratio = np.sqrt(np.mean([(t.point.error_mm / t.point.sigma_mm) ** 2 for t in done]))
    print(f"truth inside the predicted 99 % region: {inside} of {len(trials)} (required: {REQUIRED:.0%})")
    print(f"normalised error: mean {errors.mean():.2f} +- {np.sqrt(12 / len(errors)):.2f}, expected 6;", end=" ")
    print(f"largest {errors.max():.1f}; Kolmogorov-Smirnov p {kstest(errors, chi2(6).cdf).pvalue:.2f}")
    print(f"translation error, RMS: {_rms([t.truth.translation_mm for t in done]):.3f} mm", end=" ")
    print(f"(predicted {_rms([1e3 * np.linalg.norm(t.truth.sigma[3:]) for t in done]):.3f})")
    print(f"rotation error, RMS: {_rms([t.truth.rotation_deg for t in done]):.4f} deg", end=" ")
    print(f"(predicted {_rms([np.rad2deg(np.linalg.norm(t.truth.sigma[:3])) for t in done]):.4f})")
    print(f"tool point: {_rms([t.point.error_mm for t in done]):.3f} mm RMS;", end=" ")
    print(f"predicted {_rms([t.point.sigma_mm for t in done]):.3f} mm; error over prediction {ratio:.2f}")
    print(f"time a seed: {np.median([t.seconds for t in trials]):.2f} s (median)")
    return inside >= REQUIRED * len(trials)


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=100, help="how many cells (default 100)")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--views", type=int, default=20)
    parser.add_argument("--setup", choices=("eye-in-hand", "eye-to-hand"), default="eye-in-hand")
    parser.add_argument("--render", action="store_true", help="draw the pictures and find the board in them")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    options = parser.parse_args()
    trial = partial(run_trial, setup=options.setup, views=options.views, render=options.render)
    seeds = range(options.first, options.first + options.seeds)
    if options.workers > 1:
        with ProcessPoolExecutor(options.workers) as pool:
            trials = list(pool.map(trial, seeds))
    else:
        trials = [trial(seed) for seed in seeds]
    return 0 if report(trials) else 1


if __name__ == "__main__":
    sys.exit(main())
