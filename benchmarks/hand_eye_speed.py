"""How long a user waits for `calibrant hand-eye` and for `detect` when it has nothing to search: whole processes.

    python benchmarks/hand_eye_speed.py                    every case, five runs each
    python benchmarks/hand_eye_speed.py --cases pairs --runs 3
    python benchmarks/hand_eye_speed.py --cases pairs --profile 30

Cases: "views", 20 views of 63 points with a camera that they calibrate; "camera", the same with a camera given;
"pairs", 1000 robot poses and target poses; "detect", 2000 small photos whose detections are kept. Doctor, joint
refinement and leave-one-out are part of every hand-eye; a result file is written and the summary printed. A run is a
process of its own, as a user starts it; stages are clocked inside one more, what is loaded only when a stage needs it
counts for the stage. The first run of a case compiles or fills what no cache holds yet and is not counted.
Python's bytecode is kept in a folder of its own, as an installed package keeps it. Passes when the medians are at most
2 s, of "detect" 5 s.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ALLOWED_S = {"views": 2.0, "camera": 2.0, "pairs": 2.0, "detect": 5.0}
STAGES = {
    "read": ("calibrant.tasks.robots.hand_eye_list", "read"),
    "search": ("calibrant.tasks.inputs.session", "detect_boards"),
    "doctor": ("calibrant.tasks.robots.hand_eye_list", "diagnose"),
    "calibrate": ("calibrant.calibrate.cell.hand_eye", "calibrate_hand_eye"),
    "review": ("calibrant.calibrate.review.review", "review"),
    "checksums": ("calibrant.tasks.inputs.session", "file_records"),
    "summary": ("calibrant.reports.terminal", "summary"),
    "write": ("calibrant.data.results", "CalibrationResult.write"),
}
"""Stages, and the function that is clocked for each."""

CLOCKED = """
import importlib, json, sys, time
start = time.perf_counter()
spent = {}
def clocked(stage, function):
    def run(*args, **options):
        begin = time.perf_counter()
        try:
            return function(*args, **options)
        finally:
            spent[stage] = spent.get(stage, 0.0) + time.perf_counter() - begin
    return run
for stage, (module, name) in json.loads(sys.argv[1]).items():
    owner = importlib.import_module(module)
    *path, last = name.split(".")
    for part in path:
        owner = getattr(owner, part)
    setattr(owner, last, clocked(stage, getattr(owner, last)))
from calibrant.cli import application
spent["imports"] = time.perf_counter() - start
begin = time.perf_counter()
status = application.run(sys.argv[2:])
spent["command"] = time.perf_counter() - begin
print(json.dumps(spent), file=sys.stderr)
sys.exit(status)
"""
COMMAND = "from calibrant.cli import main; main()"


def make_pairs(folder: Path) -> list[str]:
    """1000 robot poses and target poses, and the arguments for them."""
    from calibrant.simulate.scenes import hand_eye_scene

    scene = hand_eye_scene("good", views=1000, seed=5)
    write_poses(folder / "robot.csv", scene.robot_poses.T_base_gripper)
    write_poses(folder / "target.csv", scene.measured_T_camera_target)
    return ["hand-eye", "--poses", "robot.csv", "--target-poses", "target.csv", *OUT]


def make_views(folder: Path) -> list[str]:
    """20 views in an observations file, their robot poses, and the arguments for them."""
    from calibrant.data.result_file import write_observations
    from calibrant.simulate.scenes import hand_eye_scene

    scene = hand_eye_scene("good", views=20, seed=5)
    write_observations(scene.observations, folder / "observations.json", force=True)
    write_poses(folder / "robot.csv", scene.robot_poses.T_base_gripper, [v.id for v in scene.observations.views])
    return ["hand-eye", "--poses", "robot.csv", "--observations", "observations.json", *OUT]


def make_camera(folder: Path) -> list[str]:
    """The same 20 views with a camera that 40 others gave."""
    from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
    from calibrant.simulate.scenes import intrinsics_scene

    known = calibrate_intrinsics(intrinsics_scene(40, seed=6).observations)
    known.write(folder / "camera.json", force=True)
    return [*make_views(folder), "--camera", "camera.json"]


def make_detect(folder: Path) -> list[str]:
    """2000 small photos of a chessboard, turned and scaled, whose detections are kept from the run not counted."""
    import cv2

    photos = folder / "photos"
    photos.mkdir()
    board = np.full((240, 320), 255, np.uint8)
    for row, column in np.ndindex(9, 12):
        if (row + column) % 2:
            board[20 + 22 * row : 42 + 22 * row, 28 + 22 * column : 50 + 22 * column] = 0
    rng = np.random.default_rng(7)
    for k in range(2000):
        turn = cv2.getRotationMatrix2D((160, 120), float(rng.uniform(-5, 5)), float(rng.uniform(0.8, 0.95)))
        photo = cv2.warpAffine(cv2.GaussianBlur(board, (3, 3), 0), turn, (320, 240), borderValue=255)
        cv2.imwrite(str(photos / f"{k:04d}.png"), photo)
    return ["detect", "photos", "--target", "chessboard:11x8:30mm", "--cache", "kept", *OUT]


OUT = ["--out", "result.json", "--force"]
MAKERS = {"views": make_views, "camera": make_camera, "pairs": make_pairs, "detect": make_detect}


def write_poses(file: Path, T: Array, names: list[str] | None = None) -> None:
    """The native form: metres, quaternion x y z w."""
    from calibrant.geometry import so3

    q = so3.quaternion_wxyz(T[:, :3, :3])[:, [1, 2, 3, 0]]
    with open(file, "w", newline="", encoding="utf-8") as stream:
        out = csv.writer(stream)
        out.writerow([*(["image"] if names else []), "x", "y", "z", "qx", "qy", "qz", "qw"])
        for i, numbers in enumerate(np.hstack([T[:, :3, 3], q]).tolist()):
            out.writerow([*([names[i]] if names else []), *numbers])


def run(code: list[str], folder: Path) -> tuple[float, str]:
    """Seconds and standard error of a process. Raises: SystemExit when it failed."""
    begin = time.perf_counter()
    kept = {"PYTHONPYCACHEPREFIX": str(Path(tempfile.gettempdir()) / "calibrant-benchmark-bytecode")}
    given = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    done = subprocess.run([sys.executable, *code], cwd=folder, capture_output=True, text=True, env=given | kept)
    seconds = time.perf_counter() - begin
    if done.returncode:
        raise SystemExit(f"{' '.join(code[-12:])}: exit status {done.returncode}\n{done.stderr}")
    return seconds, done.stderr


def clock(case: str, runs: int, profile: int) -> bool:
    """Print the case's times; True when the median is within what is allowed."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        arguments = MAKERS[case](folder)
        run(["-c", COMMAND, *arguments], folder)
        if profile:
            print(run(["-c", PROFILED, str(profile), *arguments], folder)[1])
            return True
        seconds = [run(["-c", COMMAND, *arguments], folder)[0] for _ in range(runs)]
        spent = json.loads(run(["-c", CLOCKED, json.dumps(STAGES), *arguments], folder)[1].splitlines()[-1])
    median = statistics.median(seconds)
    stages = ", ".join(f"{stage} {s:.2f}" for stage, s in spent.items() if stage != "command")
    whole = f"{median:5.2f} s ({min(seconds):.2f} to {max(seconds):.2f})"
    print(f"{case:8} {whole}; one run of {spent['command']:.2f} s: {stages}")
    return median <= ALLOWED_S[case]


PROFILED = """
import cProfile, io, pstats, sys
from calibrant.cli import application
profile = cProfile.Profile()
status = profile.runcall(application.run, sys.argv[2:])
text = io.StringIO()
for order in ("cumulative", "tottime"):
    pstats.Stats(profile, stream=text).sort_stats(order).print_stats(int(sys.argv[1]))
print(text.getvalue(), file=sys.stderr)
sys.exit(status)
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", nargs="+", choices=list(MAKERS), default=list(MAKERS))
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--profile", type=int, default=0, metavar="LINES", help="print a profile instead")
    asked = parser.parse_args()
    passed = [clock(case, asked.runs, asked.profile) for case in asked.cases]
    raise SystemExit(0 if all(passed) else 1)


if __name__ == "__main__":
    main()
