"""Projectors from rendered captures, over seeds: is the focal length right, and are errors as large as stated?

    python benchmarks/eyes/projector_pictures.py [--seeds 50] [--first 0] [--lenses short middle long]
                                                 [--codes gray both]

Each seed draws ten poses of a 9 x 7 board of 30 mm before a camera of 640 x 480 px (960 x 720 for the long lens, which
lights a small part of it) and a projector of 512 x 384 px, whose lens is shifted by half its picture's height in two of
the three. Every photo of every pattern is rendered with shot noise, blur of both lenses and 8 bits, and goes through
detection, decoding and calibration; of each photo only the part is rendered that shows the board. Errors over the
covariance are squared and divided by their degrees of freedom; terms without a sigma, if any, are named and are not
among them. focal: the worse of fx and fy.
"""

from __future__ import annotations

import argparse
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Missed, Observations, View
from calibrant.patterns.sequence import PatternSequence
from calibrant.simulate.projector.points import ProjectorPair, example_pair

LENSES = {
    "short": (0.0, 1000.0, (0.6, 1.0), (640, 480)),
    "middle": (0.5, 1500.0, (0.7, 1.1), (640, 480)),
    "long": (0.5, 2500.0, (0.9, 1.4), (960, 720)),
}
"""Shift in heights, focal length at a width of 1024 px, distances of the boards, metres, and the camera's picture."""
TARGET = "chessboard:9x7:30mm"
HALF = (0.16, 0.13)
"""Of the printed sheet, metres: the board and a white rim of a centimetre."""
MARGIN_PX = 12
PROJECTOR_SIZE = (512, 384)
VIEWS = 10


@dataclass(frozen=True)
class Row:
    """What one seed gave. focal: relative error; pose, lens, together: squared errors a degree of freedom."""

    focal: float
    distance_mm: float
    pose: float
    lens: float
    together: float
    boards: int
    rms_px: float
    left_out: tuple[str, ...]


def one(seed: int, *, lens: str, code: str) -> Row:
    """Render, detect, decode and calibrate."""
    from calibrant.calibrate.projector.calibrate import calibrate_projector
    from calibrant.simulate.projector.points import board_poses
    from calibrant.simulate.scenes import grid

    shift, focal, distance, size = LENSES[lens]
    pair = example_pair(shift=shift, focal_px=focal, image_size=size, projector_size=PROJECTOR_SIZE)
    rng = np.random.default_rng(seed)
    # The outer squares are lit too: without them the board is another one.
    whole = grid(11, 9, 0.03) - np.array([0.03, 0.03, 0.0])
    poses = board_poses(pair, whole, VIEWS, rng, distance=distance)
    sequence = PatternSequence(PROJECTOR_SIZE, code)
    views: list[View] = []
    with tempfile.TemporaryDirectory() as folder:
        for k, T in enumerate(poses):
            views += seen(pair, T, rng, sequence, str(k), Path(folder) / f"{k}.png")
    sizes = {"camera": pair.camera.image_size, "projector": PROJECTOR_SIZE}
    result = calibrate_projector(Observations(tuple(views), sizes, TARGET, tuple[Missed, ...]()))
    return scored(result, pair, sum(v.camera == "projector" for v in views))


def seen(
    pair: ProjectorPair, T: Array, rng: np.random.Generator, sequence: PatternSequence, name: str, file: Path
) -> list[View]:
    """The board in the camera's picture, and in the projector's where it is lit."""
    from calibrant.detection.pipeline import detect
    from calibrant.detection.structured_light.boards import lit_board
    from calibrant.detection.structured_light.capture import Capture
    from calibrant.errors import DetectionError
    from calibrant.opencv import cv2
    from calibrant.simulate.projector.pictures import Lighting, photographed
    from calibrant.simulate.projector.surfaces import Plane

    board = Plane(T, half=HALF, squares=(9, 7, 0.03))
    camera, corner = window(pair.camera, T)
    pictures = np.stack(list(photographed(replace(pair, camera=camera), board, sequence, rng, Lighting())))
    capture = Capture(name, sequence, pictures, sequence.names)
    cv2.imwrite(str(file), capture.white)
    try:
        v = detect([file], target=TARGET, cache=None, workers=1).views[0]
    except DetectionError:
        return []
    view = View(name, v.points, v.uv, v.point_ids, "camera", sigma_px=v.sigma_px)
    lit = lit_board(capture, view).lit
    out = [replace(view, uv=view.uv + corner)]
    if lit is not None and lit.carried is not None:
        out.append(replace(lit, carried=replace(lit.carried, uv=lit.carried.uv + corner)))
    return out


def window(camera: Camera, T_camera_target: Array) -> tuple[Camera, Array]:
    """The camera whose picture is the part of the camera's that shows the sheet, and where that begins (2,), px."""
    from calibrant.geometry import se3

    x, y = np.array([-1, 1, -1, 1]) * HALF[0] + 0.12, np.array([-1, -1, 1, 1]) * HALF[1] + 0.09
    uv = camera.project(se3.apply(T_camera_target, np.stack([x, y, np.zeros(4)], axis=1)))
    size = np.array(camera.image_size)
    low = np.clip(np.floor(uv.min(axis=0)) - MARGIN_PX, 0, size).astype(int)
    high = np.clip(np.ceil(uv.max(axis=0)) + MARGIN_PX, 0, size).astype(int)
    p = camera.parameters
    moved = p | {"cx": p["cx"] - low[0], "cy": p["cy"] - low[1]}
    width, height = (int(side) for side in high - low)
    return Camera.create(camera.model.name, moved, image_size=(width, height)), low.astype(np.float64)


def scored(result: CalibrationResult, pair: ProjectorPair, boards: int) -> Row:
    """The errors of a calibration over what it states of them."""
    from calibrant.geometry import se3
    from calibrant.simulate.truth import chi_square

    projector, place, joint = (
        result.cameras["projector"],
        result.transform("camera", "projector"),
        result.joint_covariance,
    )
    if joint is None or place.covariance is None or projector.covariance is None:
        raise RuntimeError("a projector's result has a joint covariance")
    lens_off = projector.values - pair.projector.values
    place_off = se3.local(place.matrix, pair.T_camera_projector)
    told = np.diag(projector.covariance) > 0
    first = 6 * joint.frames.index(("camera", "projector"))
    counts = {n: len(result.cameras[n].values) for n in joint.cameras}
    at = 6 * len(joint.frames) + sum(counts[n] for n in joint.cameras[: joint.cameras.index("projector")])
    pick = np.concatenate([np.arange(first, first + 6), at + np.flatnonzero(told)])
    both = np.concatenate([place_off, -lens_off[told]])
    # A transform's error is truth minus estimate, so is the lens's here.
    together = chi_square(both, joint.whole[np.ix_(pick, pick)])
    d, true = (float(np.linalg.norm(M[:3, 3])) for M in (place.matrix, pair.T_camera_projector))
    lens = chi_square(lens_off[told], projector.covariance[np.ix_(told, told)])
    return Row(
        float(np.abs(lens_off[:2] / pair.projector.values[:2]).max()),
        1e3 * (d - true),
        chi_square(place_off, place.covariance) / 6,
        lens / told.sum(),
        together / len(both),
        boards,
        result.rms_px or 0.0,
        tuple(n for n, known in zip(projector.model.parameter_names, told) if not known),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--lenses", nargs="+", default=list(LENSES), choices=LENSES)
    parser.add_argument("--codes", nargs="+", default=["gray", "both"])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--each", action="store_true", help="print every seed")
    asked = parser.parse_args()
    print(
        "| lens | code | seeds | focal off, worst | RMS | distance off | pose | projector | together | left out | RMS |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|", flush=True)
    seeds = range(asked.first, asked.first + asked.seeds)
    with ProcessPoolExecutor(asked.workers) as pool:
        for lens in asked.lenses:
            for code in asked.codes:
                rows = []
                for seed, row in zip(seeds, pool.map(partial(one, lens=lens, code=code), seeds)):
                    rows.append(row)
                    if asked.each:
                        print(f"seed {seed}: {row}", flush=True)
                print(line(lens, code, rows), flush=True)


def line(lens: str, code: str, rows: list[Row]) -> str:
    """A row of the table."""
    focal = 100 * np.array([r.focal for r in rows])
    distance = np.sqrt(np.mean([r.distance_mm**2 for r in rows]))
    pose, projector, together, rms = (
        np.mean([getattr(r, n) for r in rows]) for n in ("pose", "lens", "together", "rms_px")
    )
    left = ", ".join(sorted({n for r in rows for n in r.left_out})) or "nothing"
    return (
        f"| {lens} | {code} | {len(rows)} | {focal.max():.3f} % | {np.sqrt(np.mean(focal**2)):.3f} % "
        f"| {distance:.3f} mm | {pose:.2f} | {projector:.2f} | {together:.2f} | {left} | {rms:.3f} |"
    )


if __name__ == "__main__":
    main()
