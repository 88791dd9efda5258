"""Chessboard detection, one thread: time and recall of calibrant and OpenCV on the same images in the same run.

SYNOPSIS: python benchmarks/detection/chessboard.py [--data ../shared/data] [--images 12]

Sets: opencv_stereo_9x6 (640x480) where present, and rendered boards on a textured backdrop at 1280x720 and 1920x1080.
Times are CPU times, mean over a set, sub-pixel refinement included. Lines of two workers are wall times of the whole
pipeline, reading included, the processes' start left out.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calibrant.detection.chessboard.detector import ChessboardDetector
from calibrant.detection.images.files import expand
from calibrant.detection.images.images import load_grey
from calibrant.detection.pipeline import detect
from calibrant.targets.chessboard import Chessboard

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "detection"))

from chessboard_pictures import Lens, Pose, facing, picture  # noqa: E402

Image = NDArray[np.uint8]
TARGET = Chessboard(9, 6, 0.025)
PATTERN = (9, 6)
CLASSIC = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK


def calibrant(image: Image) -> bool:
    return len(ChessboardDetector().detect(image, TARGET).uv) == PATTERN[0] * PATTERN[1]


def sector_based(image: Image) -> bool:
    return bool(cv2.findChessboardCornersSB(image, PATTERN)[0])


def classic(image: Image) -> bool:
    found, corners = cv2.findChessboardCorners(image, PATTERN, flags=CLASSIC)
    if found:
        cv2.cornerSubPix(image, corners, (5, 5), (-1, -1), (3, 30, 1e-3))
    return bool(found)


METHODS: dict[str, Callable[[Image], bool]] = {"calibrant": calibrant, "SB": sector_based, "classic + subpix": classic}


def rendered(width: int, height: int, count: int) -> list[Image]:
    """Boards at many poses before a backdrop whose spectrum falls as 1 / f, as that of photographs."""
    rng = np.random.default_rng(7)
    images = []
    for k in range(count):
        lens = Lens(0.9 * width, width / 2, height / 2, rng.uniform(-0.25, 0.05))
        board = facing(
            9, 6, lens, distance=rng.uniform(14, 26), tilt_deg=rng.uniform(0, 50), axis_deg=rng.uniform(0, 360)
        )
        shift = np.array([rng.uniform(-3, 3), rng.uniform(-1, 1), 0.0])
        pose = Pose(board.rotation, tuple(np.array(board.translation) + shift))
        scene = picture(9, 6, pose, lens, (width, height), seed=k, backdrop=0.0, noise=0.0, dark=30.0)
        spectrum = np.fft.rfft2(rng.standard_normal((height, width)))
        f = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)[None])
        texture = np.fft.irfft2(spectrum / np.maximum(f, 1 / width), (height, width))
        backdrop = np.clip(110 + 35 * texture / texture.std(), 5, 250)
        board_pixels = cv2.dilate((scene > 15).astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
        image = np.where(board_pixels, scene, backdrop) + 2 * rng.standard_normal((height, width))
        images.append(np.clip(np.rint(image), 0, 255).astype(np.uint8))
    return images


def measure(name: str, images: list[Image]) -> None:
    times: dict[str, list[float]] = {method: [] for method in METHODS}
    found = dict.fromkeys(METHODS, 0)
    calibrant(images[0])  # the compiled functions are loaded outside the measurement
    for image in images:
        for method, run in METHODS.items():
            start = time.process_time()
            found[method] += run(image)
            times[method].append(time.process_time() - start)
    ours = float(np.mean(times["calibrant"]))
    print(f"{name}: {len(images)} images of {images[0].shape[1]}x{images[0].shape[0]}")
    for method, seconds in times.items():
        mean = float(np.mean(seconds))
        print(f"  {method:18s} {found[method]:3d} found  {1e3 * mean:8.1f} ms  {mean / ours:6.1f} x calibrant's time")


def measure_workers(images: list[Image], times: int) -> None:
    """Images a second with one worker and with two: the same files, read and searched as users' are."""
    with tempfile.TemporaryDirectory() as folder:
        files = []
        for k in range(times):
            for i, image in enumerate(images):
                files.append(Path(folder) / f"{k:02d}_{i:02d}.png")
                cv2.imwrite(str(files[-1]), image)
        rates = []
        for workers in (1, 2):
            with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
                detect(files[: 4 * workers], target=TARGET, workers=pool)  # processes start, compiled code is loaded
                start = time.perf_counter()
                detect(files, target=TARGET, workers=pool)
                rates.append(len(files) / (time.perf_counter() - start))
    one, two = rates
    print(f"{len(files)} files: one worker {one:.1f} images/s, two {two:.1f} images/s: {two / one:.2f} x")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--images", type=int, default=12)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    stereo = options.data / "opencv_stereo_9x6"
    if stereo.is_dir():
        images = [load_grey(f) for f in expand(stereo)]
        measure("opencv_stereo_9x6", images)
        measure_workers(images, 20)
    else:
        print(f"{stereo} not found: real images left out")
    for width, height in ((1280, 720), (1920, 1080)):
        images = rendered(width, height, options.images)
        measure("rendered", images)
        measure_workers(images, 10)


if __name__ == "__main__":
    main()
