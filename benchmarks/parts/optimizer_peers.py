"""Runs inside a peer's own Python and prints one JSON line: times, optimum, peak memory. See optimizer_vs_peers.py.

Needs NumPy and the peer alone. Usage: python optimizer_peers.py JOB SCENE.npz REPEATS
"""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np


def opencv(scene: Any, *, extended: bool = False) -> Callable[[], dict[str, float]]:
    import cv2

    points = [np.ascontiguousarray(p, np.float32) for p in scene["points"]]
    pixels = [np.ascontiguousarray(u[:, None], np.float32) for u in scene["uv"]]
    size = tuple(int(n) for n in scene["image_size"])

    def run() -> dict[str, float]:
        # The default term criteria stop early (30 steps, DBL_EPSILON is its own default): leave them as users do.
        solve = cv2.calibrateCameraExtended if extended else cv2.calibrateCamera
        out = solve(points, pixels, size, None, None)
        return {"rms_px": float(out[0]), "fx": float(out[1][0, 0]), "k1": float(out[2].ravel()[0])}

    return run


def mrcal(scene: Any) -> Callable[[], dict[str, float]]:
    """The solve alone from the seed given: mrcal's own seeding is part of a command line tool."""
    import mrcal as peer

    n, p, _ = scene["uv"].shape
    seen = np.ones((n, 8, p // 8, 3))
    seen[..., :2] = scene["uv"].reshape(n, 8, p // 8, 2)
    indices = np.stack([np.arange(n), np.zeros(n, int), -np.ones(n, int)], axis=-1).astype(np.int32)
    seed = np.concatenate([scene["focal"], (scene["image_size"] - 1) / 2, np.zeros(5)])[None]

    def run() -> dict[str, float]:
        inputs: dict[str, Any] = {
            "intrinsics": seed.copy(),
            "extrinsics_rt_fromref": np.zeros((0, 6)),
            "frames_rt_toref": scene["rt"].copy(),
            "points": np.zeros((0, 3)),
            "observations_board": seen.copy(),
            "indices_frame_camintrinsics_camextrinsics": indices,
            "observations_point": np.zeros((0, 3)),
            "indices_point_camintrinsics_camextrinsics": np.zeros((0, 3), np.int32),
            "lensmodel": "LENSMODEL_OPENCV5",
            "calobject_warp": None,
            "imagersizes": scene["image_size"][None].astype(np.int32),
            "calibration_object_spacing": float(scene["points"][0, 1, 0]),
            "do_optimize_calobject_warp": False,
            "do_apply_regularization": False,
            "do_apply_outlier_rejection": False,
        }
        peer.optimize(**inputs)
        a = inputs["intrinsics"][0]
        return {"fx": float(a[0]), "k1": float(a[4])}

    return run


def multiview(scene: Any) -> Callable[[], dict[str, float]]:
    """calibrateMultiview of OpenCV 5: cameras x frames, every board seen by every camera."""
    import cv2

    points = [np.ascontiguousarray(p, np.float32) for p in scene["points"]]
    pixels = [[np.ascontiguousarray(u, np.float32) for u in camera] for camera in scene["uv"]]
    cameras, frames = len(pixels), len(points)
    sizes = [tuple(int(n) for n in scene["image_size"])] * cameras
    mask = np.full((cameras, frames), 255, np.uint8)
    models = np.zeros(cameras, np.uint8)

    def run() -> dict[str, float]:
        out = cv2.calibrateMultiview(points, pixels, sizes, mask, models, None, None, None, None)
        # Rs and Ts lead from the first camera's frame to every other: T_1 is the first camera seen from the second.
        baseline = float(np.linalg.norm(np.asarray(out[4][1])))
        return {"rms_px": float(out[0]), "baseline_m": baseline}

    return run


JOBS: dict[str, Callable[[Any], Callable[[], dict[str, float]]]] = {
    "opencv": opencv,
    "opencv-extended": lambda scene: opencv(scene, extended=True),
    "mrcal": mrcal,
    "multiview": multiview,
}


def main() -> None:
    job, path, repeats = sys.argv[1], sys.argv[2], int(sys.argv[3])
    with np.load(path) as file:
        scene = {k: file[k] for k in file.files}
    run = JOBS[job](scene)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    times, found = [], {}
    for _ in range(repeats):
        start = time.perf_counter()
        found = run()
        times.append(time.perf_counter() - start)
    peak = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    print(json.dumps({"times": times, "peak_mb": peak, **found}))


if __name__ == "__main__":
    main()
