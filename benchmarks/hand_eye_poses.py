"""Hand-eye: error and stated sigma against the number of poses, beside OpenCV's five methods, with and without doctor.

    python benchmarks/hand_eye_poses.py                           40 trials; table, and docs/images/hand-eye-poses.svg
    python benchmarks/hand_eye_poses.py --trials 22               what README.md and the picture show

Camera known; 0.3 px, 0.03 degrees and 0.1 mm of noise, which is estimated, not given. Every trial takes the first n of
its 40 poses. "doctor on" examines the same data first, applies what it proposes and calibrates what is left. OpenCV's
methods (calibrateHandEye of 4.x) get the target poses of this project's own pose estimation. Passes when, from 10 poses
on, the error stays below every closed form's, the stated sigma is within a third of the error, and the doctor changes
neither by more than a tenth.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.data import CalibrationResult, Observations, RobotPoses
from calibrant.diagnose.doctor import case_of_views, examine
from calibrant.errors import CalibrantError, RefusedError
from calibrant.geometry import se3
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.scenes import grid, gripper_poses, look_at_board, observe, standard_camera, standard_mounting

Array = NDArray[np.float64]

COUNTS = (3, 4, 5, 6, 8, 10, 15, 20, 30, 40)
PX, DEG, MM = 0.3, 0.03, 0.1
METHODS = ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS")
JOINT, DOCTOR, SIGMA = "calibrant", "calibrant, doctor on", "calibrant, stated 1 σ"
PICTURE = Path(__file__).resolve().parents[1] / "docs" / "images" / "hand-eye-poses.svg"
OUT_OF_PICTURE_MM = 100.0
"""A degenerate closed form leaves metres; they are counted as this, so that one trial does not make the mean."""


@dataclass
class Tally:
    """Errors (mm) of every trial by name and number of poses; what was refused; what the doctor raised."""

    errors: dict[str, dict[int, list[float]]] = field(default_factory=dict)
    refused: dict[str, dict[int, int]] = field(default_factory=dict)
    alarms: int = 0
    examined: int = 0

    def add(self, name: str, n: int, mm: float) -> None:
        self.errors.setdefault(name, {}).setdefault(n, []).append(min(mm, OUT_OF_PICTURE_MM))

    def refuse(self, name: str, n: int) -> None:
        by_count = self.refused.setdefault(name, {})
        by_count[n] = by_count.get(n, 0) + 1

    def rms(self, name: str, n: int) -> float:
        values = self.errors.get(name, {}).get(n, [])
        return float(np.sqrt(np.mean(np.square(values)))) if values else float("nan")


def run_trial(tally: Tally, seed: int) -> None:
    rng = np.random.default_rng([7, seed])
    camera, points = standard_camera(), grid(9, 7, 0.03)
    B = look_at_board(camera, points, max(COUNTS), rng=rng, distance=(0.35, 0.75), tilt_deg=35)
    X, Z = standard_mounting("eye-in-hand")
    A = noisy_poses(gripper_poses("eye-in-hand", X, Z, B), sigma_mm=MM, sigma_deg=DEG, rng=rng)
    seen = observe(camera, points, B, sigma_px=PX, rng=rng)
    for n in COUNTS:
        some = Observations(seen.views[:n], seen.image_sizes)
        poses = RobotPoses(tuple(v.id for v in some.views), A[:n])
        found = target_poses(camera, some.views).T_camera_target
        for method in METHODS if hasattr(cv2, "calibrateHandEye") else ():
            _, t = cv2.calibrateHandEye(
                list(A[:n, :3, :3]), list(A[:n, :3, 3]), list(found[:, :3, :3]), list(found[:, :3, 3]),
                method=getattr(cv2, f"CALIB_HAND_EYE_{method}"),
            )  # fmt: skip
            mm = 1e3 * float(np.linalg.norm(t.ravel() - X[:3, 3]))
            tally.add(method.title(), n, mm if np.isfinite(mm) else OUT_OF_PICTURE_MM)
        plain = _ours(tally, JOINT, n, X, partial(_joint, poses, some))
        _ours(tally, DOCTOR, n, X, partial(_doctored, tally, poses, some, plain))


def _joint(poses: RobotPoses, some: Observations) -> CalibrationResult:
    return calibrate_hand_eye(poses, some, setup="eye-in-hand", camera=standard_camera())


def _doctored(
    tally: Tally, poses: RobotPoses, some: Observations, plain: CalibrationResult | None
) -> CalibrationResult:
    camera = standard_camera()
    case = case_of_views(poses, some, camera, setup="eye-in-hand", camera_given=True)
    examination = examine(case)
    about_motions = ("poses", "parallel-axes", "pure-translation", "half-turns", "small-rotations")
    tally.examined += 1
    tally.alarms += any(f.status != "ok" and f.name not in about_motions for f in examination.findings)
    left = examination.repaired
    if left is case and plain is not None:
        return plain  # nothing was repaired: the same data give the same result
    return calibrate_hand_eye(left.poses, left.target(), setup="eye-in-hand", camera=left.camera)


def _ours(
    tally: Tally, name: str, n: int, X: Array, calibrate: Callable[[], CalibrationResult]
) -> CalibrationResult | None:
    try:
        result = calibrate()
    except RefusedError as error:
        # What is refused for doubtful figures still has them; what cannot be determined has none.
        if not isinstance(error.result, CalibrationResult):
            tally.refuse(name, n)
            return None
        result = error.result
    except CalibrantError:
        tally.refuse(name, n)
        return None
    estimate = result.transforms[0]
    tally.add(name, n, 1e3 * float(np.linalg.norm(se3.local(X, estimate.matrix)[3:])))
    if name == JOINT:
        tally.add(SIGMA, n, float(np.linalg.norm(np.asarray(estimate.sigma_translation_mm))))
    return result


def table(tally: Tally) -> str:
    names = [m.title() for m in METHODS] + [JOINT, SIGMA, DOCTOR]
    rows = [f"| poses | {' | '.join(names)} | refused |", "|---" * (len(names) + 2) + "|"]
    for n in COUNTS:
        cells = " | ".join(f"{tally.rms(name, n):.3f}" for name in names)
        rows.append(f"| {n} | {cells} | {tally.refused.get(JOINT, {}).get(n, 0)} |")
    return "\n".join(rows)


def draw(tally: Tally, path: Path) -> None:
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams["svg.hashsalt"] = "hand-eye-poses"
    mpl.rcParams["svg.fonttype"] = "none"
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7.2, 4.4), layout="constrained")
    greys = ("#b0b0b0", "#8a8a8a", "#c98b3c", "#7d9b6a", "#9a7fb0")
    marks = ("o", "s", "^", "v", "D")
    for method, colour, mark in zip(METHODS, greys, marks):
        line = [tally.rms(method.title(), n) for n in COUNTS]
        axes.plot(
            COUNTS, line, color=colour, marker=mark, markersize=3.5, linewidth=1, label=f"OpenCV {method.title()}"
        )
    axes.plot(COUNTS, [tally.rms(JOINT, n) for n in COUNTS], color="#1450a0", linewidth=2.2, label=JOINT)
    axes.plot(COUNTS, [tally.rms(DOCTOR, n) for n in COUNTS], color="#1450a0", linestyle=":", marker="x", label=DOCTOR)
    axes.plot(COUNTS, [tally.rms(SIGMA, n) for n in COUNTS], color="#d02020", linestyle="--", label=SIGMA)
    axes.set(xscale="log", yscale="log", xlabel="poses", ylabel="error of the camera's position, mm rms")
    axes.set_xticks(COUNTS, [str(n) for n in COUNTS])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    figure.savefig(path, metadata={"Date": None})


def passes(tally: Tally) -> bool:
    good = True
    for n in (n for n in COUNTS if n >= 10):
        error, stated, doctored = (tally.rms(name, n) for name in (JOINT, SIGMA, DOCTOR))
        closed = [tally.rms(m.title(), n) for m in METHODS if m.title() in tally.errors]
        good &= all(error < c for c in closed) and abs(stated / error - 1) < 1 / 3 and abs(doctored / error - 1) < 0.1
    return good


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=40)
    parser.add_argument("--out", type=Path, default=PICTURE)
    given = parser.parse_args()
    tally = Tally()
    for seed in range(given.trials):
        run_trial(tally, seed)
    print(table(tally))
    print(f"\ndoctor: {tally.alarms} alarms in {tally.examined} clean data sets")
    draw(tally, given.out)
    return 0 if passes(tally) else 1


if __name__ == "__main__":
    sys.exit(main())
