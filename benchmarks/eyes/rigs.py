"""Rigs: how near the optimum `calibrate_rig` ends, how long it takes, and whether its sigma tells the truth.

    python benchmarks/eyes/rigs.py                             all tables, ten seeds
    python benchmarks/eyes/rigs.py --seeds 3 --only centres
    python benchmarks/eyes/rigs.py --only statistics --trials 1000 [--exact-lenses]

Scenes: a row of cameras 0.12 m apart that all see every board (`write_rig` of optimizer_vs_peers.py), and a harder one:
cameras around the boards, 1 m from one to the next and turned by 60 degrees, boards 0.5 to 1 m away, seen by those
that they face. 0.1 px of noise. The optimum is where Gauss-Newton steps end that start at the truth, by SciPy's sparse
matrices. Times are CPU seconds of one process.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import repeat

import numpy as np
import scipy.sparse as sp

from calibrant.calibrate.cell.rig import calibrate_rig
from calibrant.calibrate.stereo.depth import point_certainty
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Observations, View
from calibrant.geometry import se3, so3
from calibrant.geometry.triangulation import refine_points, triangulate
from calibrant.opencv import cv2
from calibrant.simulate.scenes import grid, look_at_board, standard_camera
from calibrant.simulate.truth import normalised

NOISE_PX = 0.1
Z95, CHI2_6_95 = 1.959964, 12.591587
POINT = np.array([0.0, 0.0, 1.0])
"""Where the cameras of `around` look at, in the frame of the first, metres."""
Array = np.ndarray


@dataclass(frozen=True)
class Scene:
    """places: T_rig_camera of every camera, the first at the origin; T_rig_board by frame."""

    camera: Camera
    places: Array
    boards: Array
    points: Array
    seen: dict[tuple[int, int], Array]
    """Pixels by (camera, frame)."""

    @property
    def observations(self) -> Observations:
        names = [f"camera {c}" for c in range(len(self.places))]
        views = tuple(
            View(f"{c}-{f}", self.points, uv, np.arange(len(self.points)), names[c], moment=str(f))
            for (c, f), uv in self.seen.items()
        )
        return Observations(views, dict.fromkeys(names, self.camera.image_size))


def visible(camera: Camera, T: Array, points: Array) -> Array | None:
    """Pixels of a board at T, None where it is not wholly in the picture, or is turned away."""
    p = se3.apply(T, points)
    if np.any(p[:, 2] < 0.1) or T[:3, 2] @ p.mean(axis=0) < 0.3 * np.linalg.norm(p.mean(axis=0)):
        return None
    uv = camera.project(p)
    inside = np.all(np.isfinite(uv)) and np.all(uv > 2) and np.all(uv < np.array(camera.image_size) - 3)
    return uv if inside else None


def row(seed: int, cameras: int, frames: int) -> Scene:
    """The scene of `write_rig`."""
    rng = np.random.default_rng(seed)
    camera, points = standard_camera(), grid(11, 8, 0.03)
    step, middle = (0.12, 1.5) if cameras <= 8 else (0.64 / cameras, (cameras - 1) / 2)
    turns = [so3.exp([0, step * (c - middle), 0]) for c in range(cameras)]
    T_camera_rig = np.stack([se3.make(R, -R @ [step * (c - middle), 0, 0]) for c, R in enumerate(turns)])
    seen: dict[tuple[int, int], Array] = {}
    boards: list[Array] = []
    while len(boards) < frames:
        for T in look_at_board(camera, points, 50, rng=rng, distance=(0.7, 1.2), tilt_deg=40):
            uv = [visible(camera, M @ T, points) for M in T_camera_rig]
            if len(boards) < frames and all(u is not None for u in uv):
                for c, u in enumerate(uv):
                    assert u is not None
                    seen[c, len(boards)] = u + NOISE_PX * rng.normal(size=u.shape)
                boards.append(T)
    return rooted(camera, se3.inverse(T_camera_rig), np.stack(boards), points, seen)


def around(seed: int, cameras: int, frames: int) -> Scene:
    """The harder scene: cameras on a circle of 1 m about the boards, 60 degrees from one to the next."""
    rng = np.random.default_rng(seed)
    camera, points = standard_camera(), grid(8, 6, 0.03)
    points = points - points.mean(axis=0)
    angles = np.deg2rad(60.0) * np.arange(cameras)
    places = []
    for a in angles:  # each looks at the middle of the circle
        R = so3.exp([0, -a, 0])
        places.append(se3.make(R, -R[:, 2]))
    seen: dict[tuple[int, int], Array] = {}
    boards: list[Array] = []
    while len(boards) < frames:
        facing = rng.uniform(angles[0], angles[-1])
        tilt = so3.exp(rng.normal(0, 0.25, 3))
        R = so3.exp([0, -facing, 0]) @ tilt @ so3.exp([0, 0, rng.uniform(-np.pi, np.pi)])
        T = se3.make(R, rng.uniform(-0.25, 0.25, 3) * [1, 0.5, 1])
        uv = [visible(camera, se3.inverse(P) @ T, points) for P in places]
        if sum(u is not None for u in uv) >= 2:
            for c, u in enumerate(uv):
                if u is not None:
                    seen[c, len(boards)] = u + NOISE_PX * rng.normal(size=u.shape)
            boards.append(T)
    return rooted(camera, np.stack(places), np.stack(boards), points, seen)


def rooted(camera: Camera, places: Array, boards: Array, points: Array, seen: dict[tuple[int, int], Array]) -> Scene:
    """In the frame of the first camera."""
    back = se3.inverse(places[0])
    return Scene(camera, back @ places, back @ boards, points, dict(sorted(seen.items())))


def optimum(scene: Scene, steps: int = 6) -> Array:
    """T_rig_camera at the least squares' end from the truth: Gauss-Newton over all lenses, places and boards."""
    C, F, n = len(scene.places), len(scene.boards), len(scene.camera.values)
    lens = np.tile(scene.camera.values, (C, 1))
    places, boards = scene.places.copy(), scene.boards.copy()
    for _ in range(steps):
        rows, data, residuals, count = [], [], [], 0
        for (c, f), uv in scene.seen.items():
            T = se3.inverse(places[c]) @ boards[f]
            p = se3.apply(T, scene.points)
            seen, J_point, J_lens = scene.camera.model.project_with_jacobians(lens[c], p)
            in_rig = se3.apply(boards[f], scene.points)
            R = places[c][:3, :3].T
            # A turn and a shift of the board in the rig's frame, about its own origin; of the camera the other way.
            of_board = np.concatenate([-so3.hat(in_rig - boards[f][:3, 3]), np.tile(np.eye(3), (len(p), 1, 1))], axis=2)
            of_place = -np.concatenate(
                [-so3.hat(in_rig - places[c][:3, 3]), np.tile(np.eye(3), (len(p), 1, 1))], axis=2
            )
            blocks = [(n * c, J_lens), (n * C + 6 * (C - 1) + 6 * f, J_point @ R @ of_board)]
            if c:
                blocks.append((n * C + 6 * (c - 1), J_point @ R @ of_place))
            for first, J in blocks:
                J = J.reshape(2 * len(p), -1)
                at = np.arange(count, count + len(J))
                rows.append((np.repeat(at, J.shape[1]), np.tile(first + np.arange(J.shape[1]), len(J))))
                data.append(J.ravel())
            residuals.append((seen - uv).ravel())
            count += 2 * len(p)
        index = np.concatenate([r for r, _ in rows]), np.concatenate([k for _, k in rows])
        J = sp.csr_matrix((np.concatenate(data), index), shape=(count, n * C + 6 * (C - 1) + 6 * F))
        step = -np.linalg.solve((J.T @ J).toarray(), J.T @ np.concatenate(residuals))
        lens += step[: n * C].reshape(C, n)
        moves = step[n * C :].reshape(-1, 6)
        places[1:] = moved(places[1:], moves[: C - 1])
        boards = moved(boards, moves[C - 1 :])
    return places


def moved(T: Array, d: Array) -> Array:
    """Turned about its own origin along the rig's axes, and shifted."""
    return np.asarray(se3.make(so3.exp(d[:, :3]) @ T[:, :3, :3], T[:, :3, 3] + d[:, 3:]))


def places_of(result: CalibrationResult, cameras: int) -> Array:
    return np.stack([np.eye(4), *(result.transform("camera 0", f"camera {c}").matrix for c in range(1, cameras))])


def centre_mm(found: Array, truth: Array) -> float:
    """RMS distance of the cameras' centres from where they are."""
    return float(1e3 * np.sqrt(np.mean(np.sum((found - truth)[1:, :3, 3] ** 2, axis=1))))


def timed(run: Callable[[], CalibrationResult]) -> tuple[CalibrationResult, float]:
    start = time.process_time()
    result = run()
    return result, time.process_time() - start


def peer(scene: Scene) -> tuple[float, float]:
    """Centre error, mm, and CPU seconds of OpenCV's calibrateMultiview; NaN where this OpenCV has none, or a camera
    does not see every board."""
    C, F = len(scene.places), len(scene.boards)
    if not hasattr(cv2, "calibrateMultiview") or len(scene.seen) < C * F:
        return float("nan"), float("nan")
    uv = np.stack([np.stack([scene.seen[c, f] for f in range(F)]) for c in range(C)])
    points = np.tile(scene.points, (F, 1, 1))
    points32 = [np.ascontiguousarray(p, np.float32) for p in points]
    pixels = [[np.ascontiguousarray(u, np.float32) for u in camera] for camera in uv]
    sizes, mask = [scene.camera.image_size] * C, np.full((C, F), 255, np.uint8)
    start = time.process_time()
    out = cv2.calibrateMultiview(points32, pixels, sizes, mask, np.zeros(C, np.uint8), None, None, None, None)
    seconds = time.process_time() - start
    T = np.stack([se3.make(cv2.Rodrigues(np.asarray(R))[0] if np.size(R) == 3 else np.asarray(R), np.ravel(t))
                  for R, t in zip(out[3], out[4])])  # fmt: skip
    return centre_mm(se3.inverse(T), scene.places), seconds


SCENES: dict[str, Callable[[int], Scene]] = {
    "row, 4 x 60": lambda seed: row(seed, 4, 60),
    "row, 8 x 100": lambda seed: row(seed, 8, 100),
    "around, 4 x 60": lambda seed: around(seed, 4, 60),
    "around, 6 x 100": lambda seed: around(seed, 6, 100),
}


def centres(seeds: int) -> None:
    head = ["scene", "error, mm", "optimum, mm", "their ratio: median, worst", "CPU s", "OpenCV, mm", "OpenCV, CPU s"]
    print(f"| {' | '.join(head)} |")
    print("|---|---|---|---|---|---|---|")
    calibrate_rig(row(0, 2, 12).observations)  # kernels are compiled and loaded
    for name, make in SCENES.items():
        rows = []
        for seed in range(seeds):
            scene = make(seed)
            observations = scene.observations
            result, seconds = timed(lambda: calibrate_rig(observations))  # noqa: B023
            ours = centre_mm(places_of(result, len(scene.places)), scene.places)
            best = centre_mm(optimum(scene), scene.places)
            theirs = peer(scene) if seed == 0 else (float("nan"),) * 2
            rows.append((ours, best, ours / best, seconds, *theirs))
        a = np.array(rows)
        m = np.median(a[:, :4], axis=0)
        print(
            f"| {name} | {m[0]:.3f} | {m[1]:.3f} | {m[2]:.2f}, {a[:, 2].max():.2f} | {m[3]:.2f} | {a[0, 4]:.2f} | "
            f"{a[0, 5]:.2f} |",
            flush=True,
        )


def growth() -> None:
    print("\n| cameras x frames | points | CPU s | s a million points |\n|---|---|---|---|")
    for cameras, frames in ((4, 50), (8, 100), (16, 100), (32, 200)):
        observations = row(0, cameras, frames).observations
        points = sum(map(len, observations.views))
        _, seconds = timed(lambda: calibrate_rig(observations))  # noqa: B023
        print(f"| {cameras} x {frames} | {points} | {seconds:.2f} | {1e6 * seconds / points:.2f} |", flush=True)


def one(seed: int, exact: bool) -> tuple[list[float], list[float], float]:
    """Of a rig of three cameras about 20 boards: e^T C^-1 e of the places of two, and errors over sigma of their
    distances from the first and of the depth of a point that the first two see."""
    scene = around(seed, 3, 20)
    observations = scene.observations
    lenses = dict.fromkeys(observations.image_sizes, replace(scene.camera, covariance=None)) if exact else None
    result = calibrate_rig(observations, cameras=lenses)
    scores, off = [], []
    for c in (1, 2):
        T = result.transform("camera 0", f"camera {c}")
        t = T.matrix[:3, 3]
        assert T.covariance is not None
        length = float(np.linalg.norm(t))
        sigma = float(np.sqrt(t @ T.covariance[3:, 3:] @ t)) / length
        scores.append(normalised(T, scene.places[c]))
        off.append((length - float(np.linalg.norm(scene.places[c][:3, 3]))) / sigma)
    return scores, off, depth_off(scene, result)


def depth_off(scene: Scene, result: CalibrationResult) -> float:
    """Error over sigma of the depth of a point amid the boards, seen exactly by the first two cameras."""
    names = ["camera 0", "camera 1"]
    eyes = [result.cameras[name] for name in names]
    T, joint = result.transform(names[0], names[1]).matrix, result.joint_covariance
    assert joint is not None
    uv = [scene.camera.project(se3.apply(se3.inverse(scene.places[c]), POINT[None])) for c in (0, 1)]
    rays = np.stack([eye.unproject(pixels) for eye, pixels in zip(eyes, uv)])
    places = np.stack([np.eye(4), T])
    (seen,) = refine_points(triangulate(rays, T_world_camera=places), rays, T_world_camera=places)
    k = len(eyes[0].values)
    lenses = [6 * len(joint.frames) + k * joint.cameras.index(n) + np.arange(k) for n in names]
    at = np.concatenate([6 * joint.frames.index((names[0], names[1])) + np.arange(6), *lenses])
    C = joint.whole[np.ix_(at, at)]
    sure = point_certainty(eyes, places, seen, covariance=C, sigma_px=(1.0, 1.0)).calibration[0]
    return float((seen[2] - POINT[2]) / np.sqrt(sure[2, 2]))


def statistics(trials: int, workers: int, *, exact: bool) -> None:
    """Normalised errors and 95 % intervals of the cameras' places, and of the depth of a point."""
    with ProcessPoolExecutor(workers) as pool:
        rows = list(pool.map(one, range(trials), repeat(exact), chunksize=10))
    places, lengths = (np.array([row[k] for row in rows]).ravel() for k in (0, 1))
    depths = np.array([row[2] for row in rows])
    lenses = "lenses given as exact" if exact else "lenses found too"
    print(f"\n{trials} rigs of 3 cameras x 20 frames, {lenses}\n\n| of | normalised | within 95 % |\n|---|---|---|")
    print(f"| place of a camera | {np.sqrt(places.mean() / 6):.3f} | {100 * np.mean(places < CHI2_6_95):.1f} % |")
    for name, off in (("distance of two cameras", lengths), ("depth of a point", depths)):
        print(f"| {name} | {np.sqrt(np.mean(off**2)):.3f} | {100 * np.mean(np.abs(off) < Z95):.1f} % |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--exact-lenses", action="store_true", help="statistics with lenses given, right, as exact")
    parser.add_argument("--only", choices=["centres", "growth", "statistics"])
    options = parser.parse_args()
    if options.only in (None, "centres"):
        centres(options.seeds)
    if options.only in (None, "growth"):
        growth()
    if options.only in (None, "statistics"):
        statistics(options.trials, options.workers, exact=options.exact_lenses)


if __name__ == "__main__":
    main()
