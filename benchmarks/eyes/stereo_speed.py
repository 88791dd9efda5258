"""The whole command on opencv_stereo_9x6, process start included, beside a script of OpenCV's functions.

    python benchmarks/eyes/stereo_speed.py [--repeats 7] [--set ../shared/data/opencv_stereo_9x6]

Both find all 26 boards and calibrate both cameras and their place; runs alternate, and processor time (user + system of
the process and its children) stands beside the clock's, which a busy machine stretches. Nothing is kept between runs.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

SCRIPT = """
import sys, glob
import cv2, numpy as np
cv2.setNumThreads(int(sys.argv[2]))
points = np.zeros((54, 3), np.float32); points[:, :2] = 25 * np.mgrid[:9, :6].T.reshape(-1, 2)
found = {}
for side in ("left", "right"):
    for file in sorted(glob.glob(sys.argv[1] + f"/{side}*.jpg")):
        grey = cv2.imread(file, cv2.IMREAD_GRAYSCALE)
        ok, corners = cv2.findChessboardCorners(grey, (9, 6))
        if ok:
            stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-4)
            corners = cv2.cornerSubPix(grey, corners, (7, 7), (-1, -1), stop)
        else:
            ok, corners = cv2.findChessboardCornersSB(grey, (9, 6))
        corners = corners.reshape(-1, 2)
        if corners[0, 0] > corners[-1, 0]:  # numbered from the other end: no board here is turned by a quarter
            corners = corners[::-1].copy()
        found.setdefault(side, []).append(corners)
size = grey.shape[::-1]
lens = {s: cv2.calibrateCamera([points] * 13, found[s], size, None, None)[1:3] for s in found}
rms, *_, R, T, E, F = cv2.stereoCalibrate(
    [points] * 13, found["left"], found["right"], *lens["left"], *lens["right"], size,
    flags=cv2.CALIB_USE_INTRINSIC_GUESS,
)
print(rms, np.linalg.norm(T))
"""


def run(command: list[str], environment: dict[str, str]) -> tuple[float, float, str]:
    """Seconds by the clock, of the processor, and what was printed."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - start, used, done.stdout


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--set", type=Path, default=Path("../shared/data/opencv_stereo_9x6"))
    given = parser.parse_args()
    left, right = (sorted(map(str, given.set.glob(f"{side}*.jpg"))) for side in ("left", "right"))
    ours = [sys.executable, "-m", "calibrant", "stereo", "--left", *left, "--right", *right]
    ours += ["--target", "chessboard:9x6:25mm", "--cache", "none", "--json"]
    theirs = [sys.executable, "-c", SCRIPT, str(given.set), str(os.cpu_count())]
    run(ours, dict(os.environ))
    times: dict[str, list[tuple[float, float]]] = {}
    for _ in range(given.repeats):
        for name, command in (("calibrant stereo", ours), ("OpenCV's functions", theirs)):
            clock, used, text = run(command, dict(os.environ))
            times.setdefault(name, []).append((clock, used))
    print("| | clock, s | processor, s |\n|---|---|---|")
    for name, rows in times.items():
        clock, used = np.median(rows, axis=0)
        print(f"| {name} | {clock:.2f} (least {min(r[0] for r in rows):.2f}) | {used:.2f} |")
    print(f"OpenCV: rms, |T| = {text.strip()}")


if __name__ == "__main__":
    main()
