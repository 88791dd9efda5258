"""Hand-eye under noise: the joint refinement against OpenCV's closed forms, and whether its covariance tells the truth.

    python benchmarks/hand_eye_noise.py                  200 trials of each row
    python benchmarks/hand_eye_noise.py --trials 30

15 poses, known intrinsics; sigma of pixels and robot is estimated, not given. The three rows are those of
../shared/PEERS.md. OpenCV's methods get the target poses of this project's own pose estimation. Passes when the
translation error is at most 0.6, 0.6 and 1.0 of the best closed form's, and the normalised error e^T C^-1 e of the
camera's transform averages 5.5 to 6.5 for its 6 degrees of freedom.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.data import RobotPoses
from calibrant.errors import CalibrantError
from calibrant.geometry import se3, so3
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.scenes import grid, gripper_poses, look_at_board, observe, standard_camera, standard_mounting
from calibrant.simulate.truth import chi_square

Array = NDArray[np.float64]

POSES = 15


@dataclass(frozen=True)
class Noise:
    """One row: noise per axis, and the share of the best closed form's error that is allowed."""

    px: float
    deg: float
    mm: float
    allowed: float


ROWS = (Noise(0.1, 0.01, 0.05, 0.6), Noise(0.3, 0.03, 0.1, 0.6), Noise(0.5, 0.2, 1.0, 1.0))


@dataclass(frozen=True, eq=False)
class Trial:
    """Squared errors (mm^2, deg^2) by method, the joint refinement's normalised error, and its estimated noise."""

    errors: dict[str, tuple[float, float]]
    normalised: float
    levels: tuple[float, float, float]


def opencv_methods(T_base_gripper: Array, T_camera_target: Array) -> dict[str, Array]:
    """T_gripper_camera by each closed form of OpenCV 4; none with OpenCV 5, which has dropped them."""
    out: dict[str, Array] = {}
    A, B = T_base_gripper, T_camera_target
    if hasattr(cv2, "calibrateHandEye"):
        for name in ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS"):
            R, t = cv2.calibrateHandEye(
                list(A[:, :3, :3]), list(A[:, :3, 3]), list(B[:, :3, :3]), list(B[:, :3, 3]),
                method=getattr(cv2, f"CALIB_HAND_EYE_{name}"),
            )  # fmt: skip
            out[name.lower()] = se3.make(R, t.ravel())
    if hasattr(cv2, "calibrateRobotWorldHandEye"):
        C = se3.inverse(A)
        for name in ("SHAH", "LI"):
            _, _, R, t = cv2.calibrateRobotWorldHandEye(
                list(B[:, :3, :3]), list(B[:, :3, 3]), list(C[:, :3, :3]), list(C[:, :3, 3]),
                method=getattr(cv2, f"CALIB_ROBOT_WORLD_HAND_EYE_{name}"),
            )  # fmt: skip
            out[name.lower()] = se3.inverse(se3.make(R, t.ravel()))
    return out


def run(job: tuple[Noise, int]) -> Trial | str:
    noise, seed = job
    rng = np.random.default_rng(1000 + seed)
    camera, points = standard_camera(), grid(9, 7, 0.03)
    B = look_at_board(camera, points, POSES, rng=rng, distance=(0.35, 0.75), tilt_deg=35)
    X, Z = standard_mounting("eye-in-hand")
    A = noisy_poses(gripper_poses("eye-in-hand", X, Z, B), sigma_mm=noise.mm, sigma_deg=noise.deg, rng=rng)
    observations = observe(camera, points, B, sigma_px=noise.px, rng=rng)
    try:
        result = calibrate_hand_eye(RobotPoses.from_matrices(A), observations, setup="eye-in-hand", camera=camera)
    except CalibrantError as error:
        return str(error)
    methods = opencv_methods(A, target_poses(camera, observations.views).T_camera_target)
    estimate = result.transforms[0]
    methods["joint"] = estimate.matrix
    errors = {
        name: (
            1e6 * float(np.sum((T[:3, 3] - X[:3, 3]) ** 2)),
            float(np.rad2deg(so3.angle(T[:3, :3] @ X[:3, :3].T)) ** 2),
        )
        for name, T in methods.items()
    }
    e = se3.local(X, estimate.matrix)
    robot = result.sigma_robot
    levels = (result.sigma_px or np.nan, robot.mm if robot else np.nan, robot.deg if robot else np.nan)
    return Trial(errors, chi_square(e, estimate.covariance), levels)


def report(noise: Noise, answers: list[Trial | str]) -> bool:
    done = [a for a in answers if isinstance(a, Trial)]
    refused = len(answers) - len(done)
    rms = {name: np.sqrt(np.mean([t.errors[name] for t in done], axis=0)) for name in done[0].errors}
    closed = {name: e for name, e in rms.items() if name != "joint"}
    nees = float(np.mean([t.normalised for t in done]))
    # Mean of n chi-squares of 6 degrees of freedom: 6 -+ sqrt(12 / n).
    spread = float(np.sqrt(12 / len(done)))
    px, mm, deg = np.median([t.levels for t in done], axis=0)
    row = f"| {noise.px} px; {noise.deg}°, {noise.mm} mm "
    good = 5.5 <= nees <= 6.5
    if closed:
        best = min(closed, key=lambda name: float(closed[name][0]))
        ratio = float(rms["joint"][0] / closed[best][0])
        good = good and ratio <= noise.allowed
        row += (
            f"| {closed[best][0]:.3f} / {closed[best][1]:.3f} ({best}) | {rms['joint'][0]:.3f} / {rms['joint'][1]:.3f} "
        )
        row += f"| {ratio:.2f} (≤ {noise.allowed}) "
    else:
        row += f"| absent: OpenCV 5 has none | {rms['joint'][0]:.3f} / {rms['joint'][1]:.3f} | "
    row += (
        f"| {nees:.2f} ± {spread:.2f} | {px:.3f} px, {deg:.4f}°, {mm:.3f} mm | {refused} | {'yes' if good else 'NO'} |"
    )
    print(row, flush=True)
    return good


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    print("| noise | best closed form of OpenCV, mm / deg | joint, mm / deg | ratio | normalised error ", end="")
    print("| noise found (median) | refused | passes |")
    print("|---" * 8 + "|")
    with ProcessPoolExecutor(options.workers) as pool:
        verdicts = [
            report(noise, list(pool.map(run, [(noise, seed) for seed in range(options.trials)], chunksize=5)))
            for noise in ROWS
        ]
    sys.exit(0 if all(verdicts) else 1)


if __name__ == "__main__":
    main()
