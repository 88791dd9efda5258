"""Corners of single markers: error and stated sigma over size, blur, tilt and noise, drawn, with known truth.

SYNOPSIS: python benchmarks/detection/tags.py [--seeds 8] [--seed 9100] [--only DICT_4X4_50]

A marker alone, 20 to 150 px wide, tilted by up to 60 degrees and turned anyhow, with one or two cells of paper around
it on a lighter or darker table, light that falls off by a tenth, noise of 0.5 to 3 % of white. Drawn at 4 to 8 times
the pixels, blurred there by 0.3 to 4 px, then averaged. Printed: RMS error per axis, px, over the chi-square per
coordinate of the stated sigma (1 when it is right; a side is shared by two corners, so 8 pictures leave it a deviation
of 0.25), and how many of the markers were found where not all were. Then the same over blur in cells, of the shortest
side in the picture.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.detection.opencv import marker_cells
from calibrant.detection.tags.detector import TagDetector
from calibrant.geometry import so3
from calibrant.opencv import cv2
from calibrant.targets.marker import Marker
from calibrant.targets.registry import parse_target

DICTIONARIES = ("DICT_APRILTAG_36h11", "DICT_4X4_50")
SIDES_PX = (20, 35, 60, 100, 150)
BLURS_PX = (0.3, 0.7, 1.5, 2.5, 4.0)
NOISE_PERCENT = (0.5, 1.0, 2.0, 3.0)
QUIET_CELLS = (1, 2)
TABLE_GREY = (40.0, 110.0, 180.0)
MOST_TILT_DEG = 60.0
FOCAL_PX = 1200.0
CELL_PX = 48
"""Of the artwork: more than any drawing shows of a cell."""
SAME_POINT_PX = 4.0
BLUR_CELLS = (0.0, 0.15, 0.25, 0.35, 0.45, 0.6)
"""Between these the second table counts."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Where a marker of side 1 stands: H (3, 3) takes its plane, origin amid it, to pixels; size: of the picture."""

    H: Array
    size: int

    @property
    def corners(self) -> Array:
        """(4, 2) px, clockwise from the top left one."""
        square = np.array([[-0.5, -0.5, 1.0], [0.5, -0.5, 1.0], [0.5, 0.5, 1.0], [-0.5, 0.5, 1.0]]) @ self.H.T
        return np.asarray(square[:, :2] / square[:, 2:])


def scene(side_px: int, room: float, rng: np.random.Generator) -> Scene:
    """A marker about side_px wide, in a picture with room (in sides) for its paper."""
    size = int(1.5 * side_px * room + 40)
    tilt = np.radians(rng.uniform(0.0, MOST_TILT_DEG)) * rng.choice([-1.0, 1.0])
    before, after = rng.uniform(-np.pi, np.pi, 2)
    R = so3.exp([0.0, 0.0, before]) @ so3.exp([tilt, 0.0, 0.0]) @ so3.exp([0.0, 0.0, after])
    depth = FOCAL_PX / side_px
    middle = np.array([*(rng.uniform(-0.5, 0.5, 2) * depth / FOCAL_PX), depth])
    K = np.array([[FOCAL_PX, 0.0, (size - 1) / 2], [0.0, FOCAL_PX, (size - 1) / 2], [0.0, 0.0, 1.0]])
    return Scene(K @ np.column_stack([R[:, 0], R[:, 1], middle]), size)


def drawn(marker: Marker, side_px: int, blur_px: float, rng: np.random.Generator) -> tuple[NDArray[np.uint8], Array]:
    """A picture and the marker's corners in it (4, 2) px."""
    quiet = int(rng.choice(QUIET_CELLS))
    cells = np.asarray(marker_cells(marker.dictionary, marker.id), np.float32)
    view = scene(side_px, 1 + 2 * quiet / len(cells), rng)
    art = np.kron(np.pad(cells, quiet, constant_values=1.0), np.ones((CELL_PX, CELL_PX), np.float32))
    # From the artwork's pixels, whose centres are whole numbers, to the marker's plane; from pixels to finer ones.
    wide = CELL_PX * len(cells)
    shift = -0.5 + (0.5 - CELL_PX * quiet) / wide
    from_art = np.array([[1 / wide, 0.0, shift], [0.0, 1 / wide, shift], [0.0, 0.0, 1.0]])
    fine = 8 if side_px < 120 else 4
    finer = np.array([[fine, 0.0, (fine - 1) / 2], [0.0, fine, (fine - 1) / 2], [0.0, 0.0, 1.0]])
    H, shape = finer @ view.H @ from_art, (view.size * fine, view.size * fine)
    light = cv2.warpPerspective(art, H, shape, flags=cv2.INTER_LINEAR)
    paper = cv2.warpPerspective(np.ones_like(art), H, shape, flags=cv2.INTER_LINEAR)
    grey = (30 + 195 * light) * paper + rng.choice(TABLE_GREY) * (1 - paper)
    angle, along = rng.uniform(0, 2 * np.pi), np.linspace(-1, 1, shape[0])
    grey *= 1 - 0.1 * (np.cos(angle) * along[None] + np.sin(angle) * along[:, None])
    blurred = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), blur_px * fine)
    seen = cv2.resize(blurred, (view.size, view.size), interpolation=cv2.INTER_AREA)
    noisy = seen + 2.55 * rng.choice(NOISE_PERCENT) * rng.standard_normal(seen.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8), view.corners


@dataclass(frozen=True, eq=False)
class Measured:
    """A marker that was shown: blur over a cell of its shortest side; error and sigma, px, (4, 2), None: not found."""

    blur_cells: float
    error: Array | None
    sigma: Array | None


def measured(dictionary: str, side_px: int, blur_px: float, *, seeds: int, seed: int) -> list[Measured]:
    """One field of the table."""
    detector, out = TagDetector(), []
    for k in range(seeds):
        rng = np.random.default_rng([seed, side_px, int(10 * blur_px), k, len(dictionary)])
        marker = parse_target(f"marker:50mm:{dictionary}:{rng.integers(0, 40)}")
        if not isinstance(marker, Marker):
            raise TypeError(marker)
        picture, truth = drawn(marker, side_px, blur_px, rng)
        shortest = np.linalg.norm(truth - np.roll(truth, 1, axis=0), axis=1).min()
        cells = len(marker_cells(marker.dictionary, marker.id))
        found = detector.detect(picture, marker)
        error, sigma = found.uv - truth[found.point_ids], found.sigma_px
        if sigma is None or len(error) == 0 or np.abs(error).max() > SAME_POINT_PX:
            out.append(Measured(blur_px * cells / shortest, None, None))
        else:
            out.append(Measured(blur_px * cells / shortest, error, np.repeat(sigma[:, None], 2, axis=1)))
    return out


def field(markers: list[Measured]) -> str:
    """RMS / chi-square of those found, and how many."""
    found = [(m.error, m.sigma) for m in markers if m.error is not None and m.sigma is not None]
    if not found:
        return "none"
    error, sigma = np.concatenate([e for e, _ in found]), np.concatenate([s for _, s in found])
    few = "" if len(found) == len(markers) else f", {len(found)} of {len(markers)}"
    return f"{np.sqrt(np.mean(error**2)):.4f} / {np.mean((error / sigma) ** 2):.2f}{few}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=8, help="pictures a field")
    parser.add_argument("--seed", type=int, default=9100)
    parser.add_argument("--only", choices=DICTIONARIES)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    write = sys.stdout.write
    write("| dictionary | blur px |" + "".join(f" {side} px |" for side in SIDES_PX) + "\n")
    write("|---|---|" + "---|" * len(SIDES_PX) + "\n")
    every: list[Measured] = []
    for dictionary in DICTIONARIES if options.only is None else (options.only,):
        for blur in BLURS_PX:
            fields = [measured(dictionary, side, blur, seeds=options.seeds, seed=options.seed) for side in SIDES_PX]
            every += [marker for of_size in fields for marker in of_size]
            write(f"| {dictionary} | {blur:g} | " + " | ".join(map(field, fields)) + " |\n")
            sys.stdout.flush()
    write("\n| blur, cells | RMS px / chi-square, found |\n|---|---|\n")
    for low, high in pairwise((*BLUR_CELLS, float("inf"))):
        write(f"| {low:g} to {high:g} | {field([m for m in every if low <= m.blur_cells < high])} |\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
