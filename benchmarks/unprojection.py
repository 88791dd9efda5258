"""Unprojection of a million pixels: time and accuracy beside OpenCV's, for the three models that it has.

    python benchmarks/unprojection.py

Both get the same pixels of the same lens; runs alternate, so that other load on the machine hits both, and the fastest
of each counts. The error is of the pixel that the ray is projected to, against the pixel it came from, the largest.
Passes when every model is at least three times as fast at equal or better accuracy.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from calibrant.cameras import camera_model

Array = NDArray[np.float64]

PIXELS = 1_000_000
RUNS = 7
REQUIRED_SPEEDUP = 3.0
SIZE = (1280, 1024)
LENSES = {
    "brown": {"k1": -0.28, "k2": 0.09, "p1": 0.0008, "p2": -0.0011, "k3": -0.012},
    "kannala_brandt": {"k1": -0.02, "k2": 0.004, "k3": -0.001, "k4": 0.0002},
    "unified": {"xi": 1.2, "k1": -0.2, "k2": 0.05, "p1": 0.0008, "p2": -0.0011},
}
FOCAL = {"brown": 900.0, "kannala_brandt": 570.0, "unified": 1500.0}
"""All pixels stay within 90 degrees of the axis, where OpenCV's normalised coordinates exist."""


def opencvs(name: str, K: Array, terms: dict[str, float]) -> Callable[[Array], Array]:
    """OpenCV's undistortion to normalised coordinates (n, 2)."""
    if name == "brown":
        distortion = np.array(list(terms.values()))
        return lambda uv: cv2.undistortPoints(uv, K, distortion)[:, 0]
    if name == "kannala_brandt":
        distortion = np.array(list(terms.values()))
        return lambda uv: cv2.fisheye.undistortPoints(uv[:, None], K, distortion)[:, 0]
    xi, *rest = terms.values()
    return lambda uv: cv2.omnidir.undistortPoints(uv[:, None], K, np.array(rest), np.array([xi]), np.eye(3))[:, 0]


def main() -> int:
    rng = np.random.default_rng(71)
    uv = rng.uniform(0, 1, (PIXELS, 2)) * SIZE
    passed = True
    print(f"{PIXELS} pixels, OpenCV {cv2.__version__}; seconds: fastest of {RUNS}; error: largest, px")
    print(f"{'model':16}{'calibrant s':>12}{'OpenCV s':>10}{'ratio':>8}{'calibrant px':>14}{'OpenCV px':>12}")
    for name, terms in LENSES.items():
        model = camera_model(name)
        f = FOCAL[name]
        named = {"fx": f, "fy": f * 1.005, "cx": 645.0, "cy": 507.0, **terms}
        values = np.array([named.get(n, 0.0) for n in model.parameter_names])
        K = np.array([[f, 0, 645.0], [0, f * 1.005, 507.0], [0, 0, 1]])
        theirs = opencvs(name, K, terms)
        model.unproject(values, uv)  # compiles
        runs = [(seconds(partial(model.unproject, values, uv)), seconds(partial(theirs, uv))) for _ in range(RUNS)]
        mine, peers = (min(t) for t in zip(*runs))
        ours = error(model.project(values, model.unproject(values, uv)), uv)
        xy = theirs(uv)
        peer = error(model.project(values, np.concatenate([xy, np.ones((len(xy), 1))], axis=1)), uv)
        ratio = peers / mine
        passed &= ratio >= REQUIRED_SPEEDUP and ours <= max(peer, 1e-9)
        print(f"{name:16}{mine:12.4f}{peers:10.4f}{ratio:8.1f}{ours:14.1e}{peer:12.1e}")
    print("passed" if passed else f"failed: expected {REQUIRED_SPEEDUP:g} times the speed at equal or better accuracy")
    return 0 if passed else 1


def seconds(function: Callable[[], object]) -> float:
    """Time of one call."""
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


def error(found: Array, uv: Array) -> float:
    """Largest distance, pixels; infinite where a pixel got no ray."""
    distance = np.linalg.norm(found - uv, axis=1)
    return float(np.max(distance)) if np.all(np.isfinite(distance)) else np.inf


if __name__ == "__main__":
    sys.exit(main())
