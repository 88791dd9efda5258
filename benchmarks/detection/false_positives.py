"""Boards reported in 200 pictures that show none, for every kind of target: must be 0.

python benchmarks/detection/false_positives.py [COUNT]
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.detection.clutter import cluttered
from tests.detection.test_clutter import SPECS

from calibrant.detection.registry import detector_for
from calibrant.targets.registry import parse_target


def main(count: int) -> int:
    """Print a line for each target; returns 1 if any board was reported."""
    pictures = [cluttered(seed) for seed in range(count)]
    wrong = 0
    for spec in SPECS:
        target = parse_target(spec)
        detector = detector_for(target.kind)
        start = time.perf_counter()
        found = [seed for seed, picture in enumerate(pictures) if detector.detect(picture, target).found]
        each_ms = 1e3 * (time.perf_counter() - start) / count
        wrong += len(found)
        sys.stdout.write(f"{spec:40} {len(found)} of {count} (pictures {found[:10]}), {each_ms:.1f} ms each\n")
        sys.stdout.flush()
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 200))
