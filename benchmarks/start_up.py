"""How long commands take to start: a first run on an empty compiler cache, and later ones.

SYNOPSIS: python benchmarks/start_up.py [--data ../shared/data] [--runs 5] [--cold 1] [--compilations] [--only NAME …]

Every command runs in a process of its own, with folders of its own for compiled functions and for detections. CPU is
user and system time of the process and of those that it waited for; the least of several runs is told, for other
programs' load only adds. --compilations lists what a first `intrinsics` compiles, function by function, in one process.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibrant.geometry import so3
from calibrant.simulate.scenes import hand_eye_scene

ROOT = Path(__file__).resolve().parent.parent
BOARD = "chessboard:9x6:25mm"
PAIRS = 1000


@dataclass(frozen=True)
class Case:
    """A command: its arguments, the exit status it ends with, and whether a first run is of interest."""

    name: str
    arguments: tuple[str, ...]
    status: int = 0
    cold: bool = False


@dataclass(frozen=True)
class Took:
    """Seconds: on the clock, and of processor time."""

    wall: float
    cpu: float


def cases(photos: Sequence[Path], folder: Path) -> list[Case]:
    """The commands that a person waits for. folder: where the poses go."""
    images = tuple(str(p) for p in photos)
    robot, target = write_poses(folder)
    return [
        Case("--help", ("--help",)),
        Case("unusable input", ("intrinsics", str(folder / "nothing.jpg"), "--target", BOARD), status=2),
        Case(f"intrinsics, {len(images)} photos", ("intrinsics", *images, "--target", BOARD, "--quiet"), cold=True),
        Case("target", ("target", BOARD, "--out", str(folder / "board.svg"), "--force", "--quiet")),
        Case(
            f"hand-eye, {PAIRS} pose pairs",
            ("hand-eye", "--poses", robot, "--target-poses", target, "--quiet"),
            cold=True,
        ),
    ]


def write_poses(folder: Path) -> tuple[str, str]:
    """Files of the robot's poses and the board's of a simulated cell."""
    scene = hand_eye_scene("good", views=PAIRS, seed=1)
    files = []
    for name, T in (("robot", scene.robot_poses.T_base_gripper), ("target", scene.measured_T_camera_target)):
        rows = np.hstack([T[:, :3, 3], so3.quaternion_wxyz(T[:, :3, :3])[:, [1, 2, 3, 0]]])
        file = folder / f"{name}.csv"
        np.savetxt(file, rows, delimiter=",", header="x,y,z,qx,qy,qz,qw", comments="")
        files.append(str(file))
    return files[0], files[1]


def environment(caches: Path) -> dict[str, str]:
    """Of a process that keeps compiled functions and detections in folders of its own."""
    return {
        **os.environ,
        "NUMBA_CACHE_DIR": str(caches / "compiled"),
        "XDG_CACHE_HOME": str(caches / "user"),
        "PYTHONPATH": str(ROOT / "src"),
    }


def run(case: Case, caches: Path) -> Took:
    """One run of a command. Raises: RuntimeError when it ends otherwise than it should."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [sys.executable, "-m", "calibrant", *case.arguments]
    done = subprocess.run(command, env=environment(caches), capture_output=True, text=True, check=False)
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != case.status:
        raise RuntimeError(f"{case.name}: exit status {done.returncode}, expected {case.status}: {done.stderr}")
    return Took(wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def least(runs: Sequence[Took]) -> Took:
    """The shortest of each."""
    return Took(min(r.wall for r in runs), min(r.cpu for r in runs))


COMPILATIONS = """
import sys, time
from numba.core import event
stack, rows = [], []
class Compilations(event.Listener):
    def on_start(self, e):
        stack.append([time.process_time(), 0.0])
    def on_end(self, e):
        start, inner = stack.pop()
        took = time.process_time() - start
        if stack:
            stack[-1][1] += took
        function = e.data["dispatcher"].py_func
        rows.append((f"{function.__module__}.{function.__qualname__}", took, took - inner))
event.register("numba:compile", Compilations())
from calibrant.cli.application import run
status = run(sys.argv[1:])
for row in rows:
    print("compiled", *row, sep="\\t", file=sys.stderr)
sys.exit(status)
"""


def list_compilations(case: Case) -> None:
    """Print what a first run compiles: how often, CPU with and without what it calls."""
    with tempfile.TemporaryDirectory() as caches:
        command = [sys.executable, "-c", COMPILATIONS, *case.arguments]
        # Bound to one core no second process takes a part of the work.
        done = subprocess.run(
            command, env=environment(Path(caches)), capture_output=True, text=True, check=True, preexec_fn=one_core
        )
    count: dict[str, int] = defaultdict(int)
    whole: dict[str, float] = defaultdict(float)
    own: dict[str, float] = defaultdict(float)
    for line in done.stderr.splitlines():
        if line.startswith("compiled\t"):
            _, name, with_callees, alone = line.split("\t")
            count[name] += 1
            whole[name] += float(with_callees)
            own[name] += float(alone)
    print(f"\n{sum(count.values())} compilations of {len(count)} functions, {sum(own.values()):.1f} s\n")
    print("| times | s with what it calls | s alone | function |\n|---|---|---|---|")
    for name in sorted(count, key=lambda n: -own[n]):
        print(f"| {count[name]} | {whole[name]:.2f} | {own[name]:.2f} | {name} |")


def one_core() -> None:
    """For a child process."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--runs", type=int, default=5, help="of each command with everything in the caches")
    parser.add_argument("--cold", type=int, default=1, help="of each command with nothing in them; 0 for none")
    parser.add_argument("--compilations", action="store_true")
    parser.add_argument("--only", nargs="*", default=[], help="commands whose names begin so")
    options = parser.parse_args()
    photos = sorted((options.data / "opencv_stereo_9x6").glob("left*.jpg"))
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        chosen = [c for c in cases(photos, folder) if not options.only or c.name.startswith(tuple(options.only))]
        if options.compilations:
            for case in chosen:
                if case.cold:
                    list_compilations(case)
            return
        print("| command | cold, s | cold, CPU s | warm, s | warm, CPU s |\n|---|---|---|---|---|")
        for case in chosen:
            cold = []
            for k in range(options.cold if case.cold else 0):
                cold.append(run(case, folder / f"cold {case.name.split()[0]} {k}"))
            run(case, folder)
            warm = least([run(case, folder) for _ in range(options.runs)])
            first = f"{least(cold).wall:.1f} | {least(cold).cpu:.1f}" if cold else " | "
            print(f"| {case.name} | {first} | {warm.wall:.2f} | {warm.cpu:.2f} |", flush=True)


if __name__ == "__main__":
    main()
