"""Pictures taken on the move: corners and intrinsics against their sigma, with and without a blur along one direction.

    python benchmarks/users/motion_blur.py [--seeds 20]

Rendered chessboards (9x6, 800x600, lens blur 0.8 px, 3 grey levels of noise), smeared evenly by 0 to 6 px. "Alike" is
the same fit without the stretch of `detection/subpixel/motion.py`: one sigma for both axes.
"""

from __future__ import annotations

import argparse

import numpy as np

import calibrant as cb
from calibrant.detection.chessboard.detector import ChessboardDetector
from calibrant.detection.detection import Detection
from calibrant.detection.subpixel import motion, saddle
from calibrant.detection.subpixel.refined import Refined, Zone
from calibrant.geometry import se3, so3
from calibrant.simulate.render import Look, render
from calibrant.targets.chessboard import Chessboard

Array = np.ndarray
BOARD = Chessboard(9, 6, 0.025)
ARTWORK = BOARD.artwork()
CAMERA = cb.Camera.create(
    "brown",
    {"fx": 900.0, "fy": 905.0, "cx": 395.0, "cy": 303.0, "k1": -0.1, "k2": 0.05, "p1": 0.0, "p2": 0.0, "k3": 0.0},
    image_size=(800, 600),
)
VIEWS = 12


def alike(
    grey: np.ndarray, uv: Array, steps: Array, dark: np.ndarray, *, radius_px: float, blur_px: float, zero_zone_px: Zone
) -> Refined:
    """As `motion.refine` has a picture at rest."""
    return saddle.refined(
        *saddle.fit(grey, uv, steps, dark, radius_px=radius_px, blur_px=blur_px, zero_zone_px=zero_zone_px)
    )


FITS = {"alike": alike, "stretched": motion.refine}


def pose(rng: np.random.Generator) -> Array:
    """A board wholly in the picture."""
    while True:
        R = so3.exp(np.array([*rng.uniform(-0.6, 0.6, 2), 0.0])) @ so3.exp(np.array([0.0, 0.0, rng.uniform(-0.3, 0.3)]))
        shift = np.array([rng.uniform(-0.08, 0.08), rng.uniform(-0.05, 0.05), rng.uniform(0.38, 0.55)])
        T = se3.make(R, shift - R @ BOARD.points.mean(axis=0))
        uv = CAMERA.project(se3.apply(T, BOARD.points))
        if uv.min() > 15 and uv[:, 0].max() < 785 and uv[:, 1].max() < 585:
            return np.asarray(T)


def taken(rng: np.random.Generator, T: Array, moved: Array) -> np.ndarray:
    look = Look(clutter=0, noise_grey=3.0, motion_px=(float(moved[0]), float(moved[1])))
    return render(ARTWORK, CAMERA, T, rng=rng, look=look)


def detected(image: np.ndarray, fit: str) -> Detection:
    """By the fit of that name: the detector finds it in its module when it is called."""
    kept, motion.refine = motion.refine, FITS[fit]
    try:
        return ChessboardDetector().detect(image, BOARD)
    finally:
        motion.refine = kept


def corners(length: float, seeds: int) -> None:
    """Errors along and across the motion, px, and over their sigma."""
    found: dict[str, list[Array]] = {fit: [] for fit in FITS}
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        T, turn = pose(rng), rng.uniform(0, np.pi)
        axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        image = taken(rng, T, length * axes[0])
        for fit in FITS:
            seen = detected(image, fit)
            error = (seen.uv - CAMERA.project(se3.apply(T, BOARD.points))[seen.point_ids]) @ axes.T
            if seen.covariance_px is None:
                sigma = np.tile(np.asarray(seen.sigma_px)[:, None], (1, 2))
            else:
                sigma = np.sqrt(np.einsum("ki,nij,kj->nk", axes, seen.covariance_px, axes))
            found[fit].append(np.concatenate([error, error / sigma], axis=1))
    for fit, rows in found.items():
        rms = np.sqrt(np.mean(np.concatenate(rows) ** 2, axis=0))
        print(f"{length:4.1f} px  {fit:9}  error {rms[0]:.4f} {rms[1]:.4f} px  over sigma {rms[2]:.2f} {rms[3]:.2f}")


def intrinsics(name: str, seeds: int, *, most: float, direction: float | None) -> None:
    """Chi-square of the lens per degree of freedom, error and sigma of fx and cx."""
    found: dict[str, list[tuple[float, ...]]] = {fit: [] for fit in FITS}
    for seed in range(seeds):
        rng = np.random.default_rng(1000 + seed)
        images = []
        for _ in range(VIEWS):
            T, length, turn = pose(rng), rng.uniform(0, most), rng.uniform(0, np.pi)
            if direction is not None:
                length, turn = most, direction
            images.append(taken(rng, T, length * np.array([np.cos(turn), np.sin(turn)])))
        for fit in FITS:
            views = []
            for i, image in enumerate(images):
                d = detected(image, fit)
                views.append(
                    cb.View(str(i), BOARD.points[d.point_ids], d.uv, d.point_ids, sigma_px=d.sigma_px,
                            covariance_px=d.covariance_px)
                )  # fmt: skip
            camera = cb.calibrate_intrinsics(cb.Observations(tuple(views), {"camera": (800, 600)})).cameras["camera"]
            C, e = np.asarray(camera.covariance), camera.values - CAMERA.values
            found[fit].append((e @ np.linalg.solve(C, e) / len(e), e[0] ** 2, C[0, 0], e[2] ** 2, C[2, 2]))
    for fit, rows in found.items():
        chi, *squares = np.mean(rows, axis=0)
        fx, s_fx, cx, s_cx = np.sqrt(squares)
        print(f"{name}  {fit:9}  chi2/dof {chi:.2f}  fx {fx:.3f} sigma {s_fx:.3f} px  cx {cx:.3f} sigma {s_cx:.3f} px")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    seeds = parser.parse_args().seeds
    for length in (0.0, 1.0, 2.0, 3.0, 4.0, 6.0):
        corners(length, seeds)
    intrinsics("0 to 6 px, any direction", seeds, most=6.0, direction=None)
    intrinsics("6 px along x            ", seeds, most=6.0, direction=0.0)


if __name__ == "__main__":
    main()
