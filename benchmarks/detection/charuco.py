"""ChArUco detection, one thread: time and recall of calibrant and of OpenCV's CharucoDetector on the same images.

SYNOPSIS: python benchmarks/detection/charuco.py [--data ../shared/data] [--every 3]

Sets: handeye_rct_charuco_static (1600x1200 photos) and the eight videos of multicam_caliscope_charuco (1280x720, a
moving board, printed as a negative; frames without the board are in them). OpenCV gets the negative turned back. CPU
times, refinement included, both in turns in one run.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calibrant.detection.charuco.detector import CharucoDetector
from calibrant.detection.images.files import expand
from calibrant.detection.images.images import load_grey
from calibrant.detection.images.video import frames
from calibrant.detection.opencv import charuco_corners
from calibrant.targets.charuco import Charuco
from calibrant.targets.registry import parse_target

ROOT = Path(__file__).resolve().parents[2]
PHOTOS = ("handeye_rct_charuco_static/images", "charuco:5x7:36.195mm:18.256mm:DICT_6X6_250")
VIDEOS = ("multicam_caliscope_charuco", "charuco:4x5:54mm:40.5mm:DICT_4X4_1000:inverted")
ENOUGH = 8
"""Corners of a view that is of use: the count that the data's own README gives."""


def measure(name: str, images: list[NDArray[np.uint8]], target: Charuco) -> np.ndarray:
    """Prints a row; returns the total seconds of both."""

    def calibrant(image: NDArray[np.uint8]) -> int:
        return len(CharucoDetector().detect(image, target).uv)

    def opencv(image: NDArray[np.uint8]) -> int:
        return len(charuco_corners(image, target)[0])

    methods: tuple[Callable[[NDArray[np.uint8]], int], ...] = (calibrant, opencv)
    seconds, counts = np.zeros((len(images), 2)), np.zeros((len(images), 2), dtype=int)
    calibrant(images[0])  # the compiled functions are loaded outside the measurement
    for k, image in enumerate(images):
        for m, run in enumerate(methods):
            start = time.process_time()
            counts[k, m] = run(image)
            seconds[k, m] = time.process_time() - start
    ms, views, corners = 1e3 * seconds.mean(axis=0), (counts >= ENOUGH).sum(axis=0), counts.sum(axis=0)
    print(
        f"{name:32s} {len(images):4d} images  calibrant {views[0]:3d} views {corners[0]:5d} corners {ms[0]:6.1f} ms  "
        f"OpenCV {views[1]:3d} views {corners[1]:5d} corners {ms[1]:6.1f} ms  ratio {ms[1] / ms[0]:4.1f}"
    )
    return seconds.sum(axis=0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--every", type=int, default=3, help="of how many frames one is taken")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    if (options.data / PHOTOS[0]).is_dir():
        target = parse_target(PHOTOS[1])
        assert isinstance(target, Charuco)
        measure(PHOTOS[0].split("/")[0], [load_grey(f) for f in expand(options.data / PHOTOS[0])], target)
    target = parse_target(VIDEOS[1])
    assert isinstance(target, Charuco)
    total = np.zeros(2)
    for video in sorted((options.data / VIDEOS[0]).glob("*/calibration/extrinsic/*.mp4")):
        images = [load_grey(frame) for frame in frames(video, 1)[:: options.every]]
        total += measure(f"{video.parts[-4][:17]} {video.stem}", images, target)
    if total.all():
        print(f"all videos: ratio {total[1] / total[0]:.2f}")


if __name__ == "__main__":
    main()
