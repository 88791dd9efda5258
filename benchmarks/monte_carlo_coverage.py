"""Do the 95 % intervals hold the truth in 95 % of calibrations? Every registered camera model, and hand-eye.

    python benchmarks/monte_carlo_coverage.py                       500 calibrations each
    python benchmarks/monte_carlo_coverage.py --trials 100 --models brown hand-eye

The views stay, the noise changes; the truth is a lens of the model itself on a scene that determines it (`SCENES` says
why it is so), so that only noise is at work. An interval is estimate -+ 1.96 sigma; the noise level is estimated, never
given. Passes when the mean over the parameters is 94-96 %, each parameter 91.5-98 %, and nothing was refused.

The mean carries its own standard error, from the spread of the share that each trial covers: parameters that move
together (k1 ... k4 of a fisheye) are covered together, and their mean is known little better than one of them.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

import numpy as np
from numpy.typing import NDArray

from calibrant.cameras import MODELS, Camera, camera_model
from calibrant.data import CalibrationResult
from calibrant.errors import CalibrantError
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import IMAGE_SIZE, Setup, grid, hand_eye_scene, look_at_board, observe

Array = NDArray[np.float64]

VIEWS, SIGMA_PX, QUANTILE, CHUNK = 20, 0.1, 1.959964, 25
MEAN_RANGE, EACH_RANGE = (0.94, 0.96), (0.915, 0.98)


@dataclass(frozen=True, eq=False)
class Scene:
    """What is seen: the true camera, the board's points (n, 3) and T_camera_target (m, 4, 4)."""

    camera: Camera
    points: Array
    T_camera_target: Array


@dataclass(frozen=True, eq=False)
class Trial:
    """Errors over their predicted sigma, by name, and e^T C^-1 e over its degrees of freedom."""

    names: tuple[str, ...]
    scores: Array
    normalised: float


def lens(model: str, **terms: float) -> Camera:
    """A camera of 1280 x 1024; terms that are not given are a few percent, with random signs."""
    kind, rng = camera_model(model), np.random.default_rng(11)
    known = {"fx": 520.0, "fy": 523.0, "cx": 645.0, "cy": 507.0, "skew": 0.8} | terms
    values = [known.get(n, 0.03 * rng.uniform(0.5, 1) * rng.choice([-1, 1])) for n in kind.parameter_names]
    return Camera(kind, IMAGE_SIZE, np.array(values))


def in_front(camera: Camera) -> Scene:
    """A board near a lens of 100 degrees, up to 57 degrees from the axis: distortion terms of every order show."""
    points = grid(11, 8, 0.03)
    rng = np.random.default_rng(7)
    return Scene(camera, points, look_at_board(camera, points, VIEWS, rng=rng, distance=(0.15, 0.45), tilt_deg=45))


def rational_lens(model: str) -> Scene:
    """Numerator and denominator differ: where they nearly cancel, their terms are not determined apart by any views."""
    rational = {"k1": 0.382, "k2": 0.096, "k3": 0.024, "k4": 0.625, "k5": -0.099, "k6": 0.078, "p1": 1e-3, "p2": -1e-3}
    return in_front(lens(model, fx=594.0, fy=597.0, **rational))


def all_around(camera: Camera, *, views: int = VIEWS, margin: float = 100.0, points: Array | None = None) -> Scene:
    """Boards all over the field of a fisheye of 180 degrees: the shape of its field shows far from the axis alone.

    margin: pixels from the image's edge to where a board's middle may be; points outside the image are not seen.
    """
    points = grid(11, 8, 0.03) if points is None else points
    rng = np.random.default_rng(7)
    uv = rng.uniform((margin, margin), np.array(IMAGE_SIZE) - margin, (views, 2))
    ray = camera.unproject(uv)
    side = np.cross([0.0, 0.0, 1.0], ray)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    to_ray = so3.exp(side * np.arccos(ray[:, 2:]))
    direction = rng.uniform(0, 2 * np.pi, views)
    tilt = np.deg2rad(45) * np.sqrt(rng.uniform(0, 1, views))
    lean = so3.exp(tilt[:, None] * np.column_stack([np.cos(direction), np.sin(direction), 0 * direction]))
    R = to_ray @ lean @ so3.exp(rng.uniform(-np.pi, np.pi, (views, 1)) * [0, 0, 1])
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return Scene(camera, points, se3.make(R, ray * rng.uniform(0.2, 0.5, (views, 1)) - R @ middle))


def telecentric(model: str) -> Scene:
    """A board that fills the object field of a telecentric lens of 8 px / mm, leaning: foreshortening shows fx, fy."""
    centre = dict(zip(("cx", "cy"), (np.array(IMAGE_SIZE) - 1) / 2))
    camera, points = lens(model, fx=8000.0, fy=8030.0, **centre), grid(11, 8, 0.009)
    rng = np.random.default_rng(7)
    direction, tilt = rng.uniform(0, 2 * np.pi, VIEWS), np.deg2rad(rng.uniform(15, 45, VIEWS))
    R = so3.exp(tilt[:, None] * np.column_stack([np.cos(direction), np.sin(direction), 0 * direction]))
    R = R @ so3.exp(rng.uniform(-np.pi, np.pi, (VIEWS, 1)) * [0, 0, 1])
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    place = rng.uniform((-0.015, -0.012, 0.2), (0.015, 0.012, 0.3), (VIEWS, 3))
    return Scene(camera, points, se3.make(R, place - R @ middle))


def smooth_surface(model: str) -> Scene:
    """A barrel-shaped lens with decentring as a surface of control points, seen by 40 boards out to its corners.

    Where few points are seen the prior of a smooth surface decides, and intervals are wider than the errors.
    """
    kind = camera_model(model)
    columns, rows = (int(n) for n in model.split(":")[1].split("x"))
    y, x = np.meshgrid(np.linspace(-1, 1, rows) * rows / columns, np.linspace(-1, 1, columns), indexing="ij")
    s = x * x + y * y
    surface = {"x": -0.06 * x * s + 0.004 * (s + 2 * x * x), "y": -0.06 * y * s + 0.006 * x * y}
    terms = {f"{a}{j}_{i}": float(v[j, i]) for a, v in surface.items() for j in range(rows) for i in range(columns)}
    camera = lens(kind.name, fx=700.0, fy=703.0, cx=640.0, cy=512.0, **terms)
    return all_around(camera, views=40, margin=10.0, points=grid(17, 12, 0.02))


SCENES: dict[str, Callable[[str], Scene]] = {
    **dict.fromkeys(("rational", "thin_prism", "tilted"), rational_lens),
    "kannala_brandt": lambda m: all_around(lens(m, fx=420.0, fy=422.0)),
    "unified": lambda m: all_around(lens(m, fx=924.0, fy=928.0, xi=1.2)),
    "extended_unified": lambda m: all_around(lens(m, fx=420.0, fy=422.0, alpha=0.62, beta=1.1)),
    "double_sphere": lambda m: all_around(lens(m, fx=336.0, fy=338.0, xi=-0.2, alpha=0.6)),
    "orthographic": telecentric,
    "splined": smooth_surface,
}


def camera_trial(scene: Scene, model: str, rng: np.random.Generator) -> Trial:
    """One calibration. Splined: angles between rays, other models: their own parameters."""
    from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics

    noisy = observe(scene.camera, scene.points, scene.T_camera_target, sigma_px=SIGMA_PX, rng=rng)
    found = calibrate_intrinsics(noisy, model=model).camera
    if model.startswith("splined"):
        names, error, C = ray_angles(scene.camera, found)
    else:
        assert found.covariance is not None
        free = np.diag(found.covariance) > 0
        names = tuple(n for n, f in zip(found.model.parameter_names, free) if f)
        error, C = (found.values - scene.camera.values)[free], found.covariance[np.ix_(free, free)]
    return Trial(names, error / np.sqrt(np.diag(C)), normalised(error, C))


def ray_angles(truth: Camera, found: Camera) -> tuple[tuple[str, ...], Array, Array]:
    """Angles between the rays of neighbouring pixels of a grid: their errors (n,), radians, and covariance (n, n).

    Control points are tied to the poses (a turn of the camera bends the surface back), to fx and fy, and where no point
    was seen to a prior: their values depend on the gauge. Angles between rays do not.
    """
    width, height = truth.image_size
    u, v = np.meshgrid(np.linspace(0.15, 0.85, 5) * width, np.linspace(0.15, 0.85, 4) * height)
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    rays, true = found.unproject(uv), truth.unproject(uv)
    _, J_p, J_k = found.model.project_with_jacobians(found.values, rays)
    basis = np.linalg.svd(rays[:, None])[2][:, 1:].swapaxes(1, 2)
    J = -basis @ np.linalg.solve(J_p @ basis, J_k)
    first = np.concatenate([np.flatnonzero(np.arange(20) % 5 < 4), np.arange(15)])
    second = np.concatenate([first[:16] + 1, np.arange(15) + 5])
    cosine = np.sum(rays[first] * rays[second], axis=1)
    slope = rays[first][:, None] @ J[second] + rays[second][:, None] @ J[first]
    G = -slope[:, 0] / np.sqrt(1 - cosine**2)[:, None]
    error = np.arccos(cosine) - np.arccos(np.sum(true[first] * true[second], axis=1))
    return tuple(f"angle {a}-{b}" for a, b in zip(first, second)), error, G @ found.covariance @ G.T


def hand_eye_trial(name: str, seed: int) -> Trial:
    """One hand-eye calibration: with images and known intrinsics, or from pose pairs; new poses and noise each."""
    from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye

    family, setup_name = name.split()
    setup: Setup = "eye-in-hand" if setup_name == "eye-in-hand" else "eye-to-hand"
    scene = hand_eye_scene("good", setup=setup, seed=seed)
    if family == "pose-pairs":
        result = calibrate_hand_eye(scene.robot_poses, scene.measured_T_camera_target, setup=setup)
    else:
        result = calibrate_hand_eye(scene.robot_poses, scene.observations, setup=setup, camera=scene.camera)
    return transform_scores(result, (scene.X, scene.Z))


def transform_scores(result: CalibrationResult, truths: tuple[Array, Array]) -> Trial:
    names: list[str] = []
    scores, chi = [], []
    for estimate, truth in zip(result.transforms, truths):
        C, error = np.asarray(estimate.covariance), se3.local(truth, estimate.matrix)
        scores.append(error / np.sqrt(np.diag(C)))
        chi.append(normalised(error, C))
        names += [f"{estimate.child} {a}" for a in ("rx", "ry", "rz", "x", "y", "z")]
    return Trial(tuple(names), np.concatenate(scores), chi[0])


def normalised(error: Array, C: Array) -> float:
    """e^T C^-1 e over its degrees of freedom: 1 on average."""
    scale = 1 / np.sqrt(np.diag(C))
    values, vectors = np.linalg.eigh(C * scale[:, None] * scale)
    keep = values > 1e-12 * values[-1]
    return float(np.sum((vectors[:, keep].T @ (error * scale)) ** 2 / values[keep]) / keep.sum())


def run(job: tuple[str, int, int]) -> tuple[list[Trial], list[str], float]:
    """Trials of one chunk, the reasons of those refused, and the time."""
    name, chunk, trials = job
    began, done, refused = time.perf_counter(), [], []
    scene = None if "eye-" in name else SCENES.get(name.split(":")[0], lambda m: in_front(lens(m)))(name)
    rng = np.random.default_rng([2026, chunk])
    for k in range(trials):
        try:
            done.append(hand_eye_trial(name, CHUNK * chunk + k) if scene is None else camera_trial(scene, name, rng))
        except CalibrantError as error:
            refused.append(str(error))
    return done, refused, time.perf_counter() - began


def report(name: str, done: list[Trial], refused: list[str], seconds: float) -> bool:
    """One row of the table."""
    if not done:
        print(f"| {name} | 0 | | | | | {len(refused)}: {refused[0][:90]} | NO |", flush=True)
        return False
    hit = np.abs(np.stack([t.scores for t in done])) <= QUANTILE
    covered, names = hit.mean(axis=0), done[0].names
    mean, low, high = float(covered.mean()), int(np.argmin(covered)), int(np.argmax(covered))
    error = float(hit.mean(axis=1).std() / np.sqrt(len(done)))
    each = EACH_RANGE[0] <= covered.min() and covered.max() <= EACH_RANGE[1]
    good = MEAN_RANGE[0] <= mean <= MEAN_RANGE[1] and each and not refused
    cells = (
        name,
        str(len(done)),
        f"{100 * mean:.1f} ± {100 * error:.1f} %",
        f"{100 * covered[low]:.1f} % ({names[low]})",
        f"{100 * covered[high]:.1f} % ({names[high]})",
        f"{np.mean([t.normalised for t in done]):.2f}",
        f"{1e3 * seconds / (len(done) + len(refused)):.0f}",
        str(len(refused)),
        "yes" if good else "NO",
    )
    print(f"| {' | '.join(cells)} |", flush=True)
    for reason, count in Counter(r[:160] for r in refused).most_common(3):
        print(f"  refused {count}: {reason}", file=sys.stderr)
    return good


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--models", "--only", nargs="*", default=None, help="names of models, hand-eye, or pose-pairs")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    setups = [f"{family} {setup}" for family in ("hand-eye", "pose-pairs") for setup in ("eye-in-hand", "eye-to-hand")]
    names = [*MODELS, *setups]
    if options.models is not None:
        names = [n for n in names if n in options.models or n.split()[0].split(":")[0] in options.models]
    print(
        "| model | calibrations | mean | lowest | highest | chi²/n | ms each | refused | passes |\n|---|" + "---|" * 8
    )
    verdicts = []
    # Workers that are started afresh read it: a process a core, not a process and a thread of BLAS a core.
    os.environ.update({"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"})
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
        for name in names:
            sizes = [min(CHUNK, options.trials - a) for a in range(0, options.trials, CHUNK)]
            answers = list(pool.map(run, [(name, chunk, size) for chunk, size in enumerate(sizes)]))
            done, refused = [t for a in answers for t in a[0]], [r for a in answers for r in a[1]]
            verdicts.append(report(name, done, refused, sum(a[2] for a in answers)))
    print(f"\n{sum(verdicts)} of {len(verdicts)} pass")
    sys.exit(0 if all(verdicts) else 1)


if __name__ == "__main__":
    main()
