"""Do the 95 % intervals hold the truth in 95 % of calibrations? Every registered camera model, and hand-eye.

    python benchmarks/monte_carlo_coverage.py                       500 calibrations each
    python benchmarks/monte_carlo_coverage.py --trials 100 --only brown hand-eye

The views stay, the noise changes; the truth is a wide lens of the model itself, so that only noise is at work. An
interval is estimate -+ 1.96 sigma; the noise level is estimated, never given. Passes when the mean over the parameters
is 94-96 % and each parameter 91.5-98 %.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.cameras import Camera, camera_model
from calibrant.errors import CalibrantError

Array = NDArray[np.float64]

VIEWS, SIGMA_PX, QUANTILE = 20, 0.1, 1.959964
MEAN_RANGE, EACH_RANGE = (0.94, 0.96), (0.915, 0.98)


@dataclass(frozen=True, eq=False)
class Trial:
    """Errors over their predicted sigma, by parameter."""

    names: tuple[str, ...]
    scores: Array


def plausible_camera(model: str) -> Camera:
    """A lens of about 100 degrees, which shows every model's terms; distortion of a few percent in each of them."""
    kind = camera_model(model)
    rng = np.random.default_rng(11)
    known = {"fx": 520.0, "fy": 523.0, "cx": 645.0, "cy": 507.0, "skew": 0.8, "alpha": 0.55, "beta": 1.1, "xi": 0.2}
    terms = {n: known.get(n, 0.03 * rng.uniform(0.5, 1) * rng.choice([-1, 1])) for n in kind.parameter_names}
    return Camera(kind, (1280, 1024), np.array(list(terms.values())))


def camera_trials(model: str, trials: int) -> list[Trial]:
    """Calibrations of one model on the same views with new noise."""
    from calibrant.calibrate.intrinsics import calibrate_intrinsics
    from calibrant.simulate.scenes import grid, look_at_board, observe

    rng = np.random.default_rng(7)
    camera, points = plausible_camera(model), grid(11, 8, 0.03)
    T = look_at_board(camera, points, VIEWS, rng=rng, distance=(0.15, 0.45), tilt_deg=45)
    out = []
    for _ in range(trials):
        noisy = observe(camera, points, T, sigma_px=SIGMA_PX, rng=rng)
        found = calibrate_intrinsics(noisy, model=model).camera
        sigma = np.array(list(found.sigma.values()))
        free = sigma > 0
        names = tuple(n for n, f in zip(found.model.parameter_names, free) if f)
        out.append(Trial(names, (found.values - camera.values)[free] / sigma[free]))
    return out


def hand_eye_trials(setup: str, trials: int) -> list[Trial]:
    """Joint refinements with known intrinsics; new noise of pixels and robot every time."""
    from calibrant.calibrate.hand_eye.calibrate import calibrate_hand_eye
    from calibrant.geometry import se3
    from calibrant.simulate.scenes import hand_eye_scene

    out = []
    for seed in range(trials):
        scene = hand_eye_scene("good", setup=setup, seed=seed)  # type: ignore[arg-type]
        result = calibrate_hand_eye(scene.robot_poses, scene.observations, setup=setup, camera=scene.camera)
        scores, names = [], []
        for estimate, truth in zip(result.transforms, (scene.X, scene.Z)):
            if estimate.covariance is None:
                raise SystemExit("a hand-eye result without covariance")
            scores.append(se3.local(truth, estimate.matrix) / np.sqrt(np.diag(estimate.covariance)))
            names += [f"{estimate.child} {a}" for a in ("rx", "ry", "rz", "x", "y", "z")]
        out.append(Trial(tuple(names), np.concatenate(scores)))
    return out


def run(job: tuple[str, int]) -> tuple[str, list[Trial] | str]:
    name, trials = job
    try:
        if name.startswith("hand-eye"):
            return name, hand_eye_trials(name.removeprefix("hand-eye "), trials)
        return name, camera_trials(name, trials)
    except CalibrantError as error:
        return name, str(error)


def report(name: str, answer: list[Trial] | str) -> bool | None:
    """One row of the table; None when the model cannot be calibrated on this scene."""
    if isinstance(answer, str):
        print(f"| {name} | refused | | | {answer[:90]} |", flush=True)
        return None
    scores = np.stack([t.scores for t in answer])
    covered = np.mean(np.abs(scores) <= QUANTILE, axis=0)
    mean, low, high = float(covered.mean()), int(np.argmin(covered)), int(np.argmax(covered))
    names = answer[0].names
    good = MEAN_RANGE[0] <= mean <= MEAN_RANGE[1] and covered.min() >= EACH_RANGE[0] and covered.max() <= EACH_RANGE[1]
    print(
        f"| {name} | {100 * mean:.1f} % | {100 * covered[low]:.1f} % ({names[low]}) | "
        f"{100 * covered[high]:.1f} % ({names[high]}) | {'yes' if good else 'NO'} |",
        flush=True,
    )
    return bool(good)


def main() -> None:
    from calibrant.cameras import MODELS

    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--only", nargs="*", default=None, help="names of models, or hand-eye")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    jobs = [*MODELS, "hand-eye eye-in-hand", "hand-eye eye-to-hand"]
    if options.only is not None:
        jobs = [j for j in jobs if j in options.only or j.split()[0] in options.only]
    print("| model | mean | lowest | highest | passes |\n|---|---|---|---|---|")
    with ProcessPoolExecutor(options.workers) as pool:
        verdicts = [report(*answer) for answer in pool.map(run, [(j, options.trials) for j in jobs])]
    print(f"\n{sum(v is True for v in verdicts)} of {len(verdicts)} pass, {options.trials} calibrations each")
    sys.exit(0 if all(v is not False for v in verdicts) else 1)


if __name__ == "__main__":
    main()
