"""Projectors: statistics over seeds from points of three lenses, scans, and a public set.

    python benchmarks/projector.py [--seeds 50] [--captures DIR] [--parts points scans public]

Lenses are shifted by half the picture's height in two of the three; rendered captures: eyes/projector_pictures.py.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

import calibrant as cb
from calibrant.calibrate.projector.calibrate import calibrate_projector
from calibrant.data import CalibrationResult
from calibrant.detection.structured_light.capture import Capture
from calibrant.detection.structured_light.decode import decode
from calibrant.geometry import se3, so3
from calibrant.patterns.sequence import PatternSequence
from calibrant.perceive.scan.points import scan
from calibrant.perceive.stereo.eyes import Eyes
from calibrant.simulate.projector.pictures import Lighting, photographed
from calibrant.simulate.projector.points import ProjectorPair, board_poses, carried_views, example_pair
from calibrant.simulate.projector.surfaces import Box, Plane, Scene, Sphere
from calibrant.simulate.scenes import grid
from calibrant.simulate.truth import normalised

LENSES = {"short": (0.0, 1000.0), "middle": (0.5, 1500.0), "long": (0.5, 2500.0)}
POINTS, TARGET = grid(9, 7, 0.03), "chessboard:9x7:30mm"


def errors(result: CalibrationResult, pair: ProjectorPair) -> tuple[float, float, float]:
    """Worst relative error of a focal length; normalised squared error a degree of freedom of pose and of projector."""
    projector = result.cameras["projector"]
    off = projector.values - pair.projector.values
    free = np.array([s > 0 for s in projector.sigma.values()])
    C = np.asarray(projector.covariance)[np.ix_(free, free)]
    lens = float(off[free] @ np.linalg.solve(C, off[free])) / free.sum()
    pose = normalised(result.transform("camera", "projector"), pair.T_camera_projector) / 6
    return float(np.abs(off[:2] / pair.projector.values[:2]).max()), pose, lens


def from_points(seeds: int) -> None:
    print("lens    focal off, worst  mean squared error / covariance: pose  projector   s a calibration")
    for name, (shift, focal) in LENSES.items():
        pair, found = example_pair(shift=shift, focal_px=focal), []
        start = time.process_time()
        for seed in range(seeds):
            rng = np.random.default_rng(seed)
            poses = board_poses(pair, POINTS, 12, rng, distance=(0.7, 1.1))
            seen = carried_views(pair, POINTS, poses, rng, corner_px=0.05, decoded_px=0.03)
            found.append(errors(calibrate_projector(seen), pair))
        worst, pose, lens = np.max(found, axis=0)[0], *np.mean(found, axis=0)[1:]
        each = (time.process_time() - start) / seeds
        print(f"{name:8}{100 * worst:14.3f} %{pose:40.2f}{lens:11.2f}{each:14.2f}")


def scans() -> None:
    print("code    distance  thing    points   chi^2   RMS, mm   sigma, mm")
    pair = example_pair(image_size=(480, 360), projector_size=(512, 384))
    places = np.stack([np.eye(4), pair.T_camera_projector])
    eyes = Eyes(("camera", "projector"), (pair.camera, pair.projector), places, np.zeros((24, 24)))
    for code in ("gray", "phase", "both"):
        for m in (0.5, 1.0, 2.0):
            wall = Plane(se3.make(so3.exp([0.1, 0.2, 0]), [0, 0, 1.15 * m]), half=(m, m))
            at = np.array([0, -0.05 * m, m])
            ball, box = (
                Sphere(at, 0.15 * m),
                Box(se3.make(so3.exp([0.5, 0.6, 0.2]), at), m * np.array([0.12, 0.1, 0.11])),
            )
            for name, thing in (("plane", wall), ("sphere", Scene((wall, ball))), ("box", Scene((wall, box)))):
                sequence = PatternSequence((512, 384), code)
                lighting = Lighting(distance_m=m)
                pictures = np.stack(list(photographed(pair, thing, sequence, np.random.default_rng(1), lighting)))
                found = scan(decode(Capture(name, sequence, pictures, sequence.names)), eyes)
                rays = pair.camera.unproject(found.uv.astype(np.float64))
                off = found.points[:, 2] - thing.hit(np.zeros(3), rays).distance * rays[:, 2]
                chi = float(np.mean((off / found.by_pixels) ** 2))
                rms, sigma = 1e3 * np.sqrt(np.mean(off**2)), 1e3 * np.median(found.by_pixels)
                print(f"{code:8}{m:6.1f} m  {name:8}{len(off):7}{chi:8.3f}{rms:10.3f}{sigma:12.3f}", flush=True)


def public(folder: Path) -> None:
    if not folder.is_dir():
        print(f"{folder} is not there: skipped")
        return
    result = cb.projector_calibrate(captures=str(folder), projector_size="1024x768", target="chessboard:9x7:75mm")
    place = result.transform("camera", "projector")
    t = place.matrix[:3, 3]
    d = float(np.linalg.norm(t))
    sigma = float(np.sqrt(t @ np.asarray(place.covariance)[3:, 3:] @ t)) / d
    print(f"RMS {result.rms_px:.3f} px, distance {1e3 * d:.1f} ± {1e3 * sigma:.1f} mm; {result.verdict}")
    for check in result.checks:
        if check.name.startswith(("weak-terms", "lens-shift")):
            print(check.message)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--captures", type=Path, default=Path("../shared/data/procam_kamino_graycode"))
    parser.add_argument("--parts", nargs="+", default=["points", "scans", "public"])
    asked = parser.parse_args()
    if "points" in asked.parts:
        from_points(asked.seeds)
    if "scans" in asked.parts:
        scans()
    if "public" in asked.parts:
        public(asked.captures)


if __name__ == "__main__":
    main()
