"""Are the errors of a stereo pair as large as it states? Pairs of points, no pictures, over many seeds.

    python benchmarks/eyes/stereo.py [--seeds 1000] [--first 0] [--workers 2] [--exact-lenses]

Each seed draws 14 poses of a 9 x 6 board of 25 mm before two cameras of different lens and size, 120 mm apart, 0.1 px
of noise; the right one misses part of some boards. Normalised: root mean square of error over stated sigma (of the
transform e^T C^-1 e / 6), 1 where the statement is true; covered: how often the truth lies within the 95 % interval.
Depth is that of a point amid the boards, seen exactly by both: what is off is the calibration alone.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import repeat

import numpy as np

Z95 = 1.959964
CHI2_6_95 = 12.591587
POINT = (0.02, 0.01, 0.65)
"""Left camera's frame, metres."""


def one(seed: int, exact: bool) -> tuple[float, float, float]:
    """e^T C^-1 e of the transform, and errors over sigma of baseline and depth."""
    from calibrant.calibrate.stereo.calibrate import calibrate_stereo
    from calibrant.calibrate.stereo.depth import point_certainty
    from calibrant.geometry import se3
    from calibrant.geometry.triangulation import refine_points, triangulate
    from calibrant.simulate.stereo import stereo_scene
    from calibrant.simulate.truth import normalised

    scene = stereo_scene(seed)
    lenses = {side: replace(camera, covariance=None) for side, camera in scene.cameras.items()} if exact else None
    found = calibrate_stereo(scene.observations, cameras=lenses)
    T = found.transform("left", "right")
    baseline = found.figures["baseline"]
    off = baseline.value - 1e3 * float(np.linalg.norm(scene.T_left_right[:3, 3]))
    left, right = (found.cameras[side] for side in ("left", "right"))
    p = np.array([POINT])
    uv = (
        scene.cameras["left"].project(p),
        scene.cameras["right"].project(se3.apply(se3.inverse(scene.T_left_right), p)),
    )
    rays = np.stack([left.unproject(uv[0]), right.unproject(uv[1])])
    places = np.stack([np.eye(4), T.matrix])
    (seen,) = refine_points(triangulate(rays, T_world_camera=places), rays, T_world_camera=places)
    if found.joint_covariance is None:
        raise RuntimeError("a stereo result has a joint covariance")
    sure = point_certainty(
        (left, right), places, seen, covariance=found.joint_covariance.whole, sigma_px=(1.0, 1.0)
    ).calibration[0]
    return normalised(T, scene.T_left_right), off / baseline.sigma, float((seen[2] - POINT[2]) / np.sqrt(sure[2, 2]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--exact-lenses", action="store_true", help="lenses given, right, as exact")
    given = parser.parse_args()
    with ProcessPoolExecutor(given.workers) as pool:
        seeds = range(given.first, given.first + given.seeds)
        rows = np.array(list(pool.map(one, seeds, repeat(given.exact_lenses), chunksize=10)))
    print("| of | normalised | within 95 % |\n|---|---|---|")
    print(f"| transform | {np.sqrt(rows[:, 0].mean() / 6):.3f} | {100 * np.mean(rows[:, 0] < CHI2_6_95):.1f} % |")
    for k, name in ((1, "baseline"), (2, "depth of a point")):
        print(f"| {name} | {np.sqrt(np.mean(rows[:, k] ** 2)):.3f} | {100 * np.mean(abs(rows[:, k]) < Z95):.1f} % |")


if __name__ == "__main__":
    main()
