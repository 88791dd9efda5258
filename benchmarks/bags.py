"""Memory and time that bags take: one of 200 MB and one of 2 GB of each kind, made in a folder that is deleted after.

    python benchmarks/bags.py

Every picture is read and measured, and the robot's motion with it, as `calibrant intrinsics` and `hand-eye` do.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

SIZES_MB = (200, 2000)


def read(bag: Path) -> None:
    """Prints what one pass took."""
    from calibrant.tasks.inputs.bags.motion import robot_motion
    from calibrant.tasks.inputs.bags.sharpest import only_camera
    from calibrant.tasks.options.bags import MovingBagOptions
    from calibrant.tasks.options.robots import RobotOptions

    warnings.simplefilter("ignore")
    start = time.perf_counter()
    options = MovingBagOptions(bag=bag, tf="base:tool0")
    poses = len(robot_motion(options, RobotOptions()).motion.times)
    pictures = len(only_camera(options, ()))
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    took = time.perf_counter() - start
    print(f"  {pictures} pictures chosen, {poses} poses: {most:.0f} MB at most, {took:.1f} s", flush=True)


def write(folder: Path, kind: str, megabytes: int) -> Path:
    """A bag of noise."""
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from tests.made_bags import written_bag

    rng = np.random.default_rng(0)
    pictures = [rng.integers(0, 256, (480, 640, 3), np.uint8) for _ in range(4)]
    with written_bag(folder, kind) as (bag, writer):
        for k in range(int(1e6 * megabytes / pictures[0].nbytes)):
            for t in k / 15 + np.arange(7) / 105:
                T = np.eye(4)
                T[0, 3] = np.sin(t)
                writer.transforms("/tf", {("base", "tool0"): T}, float(t))
            writer.image("/image", pictures[k % 4], k / 15, "bgr8")
    return bag


def main() -> None:
    """All kinds and sizes, each read by a process of its own."""
    for kind in ("ros1", "sqlite3", "mcap"):
        for megabytes in SIZES_MB:
            with tempfile.TemporaryDirectory() as folder:
                print(f"{kind}, {megabytes} MB", flush=True)
                bag = write(Path(folder), kind, megabytes)
                subprocess.run([sys.executable, __file__, str(bag)], check=True)


if __name__ == "__main__":
    main() if len(sys.argv) == 1 else read(Path(sys.argv[1]))
