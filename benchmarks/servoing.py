"""Servoing and grasps on the move in simulated cells: how near the arm comes by the truth, and how often.

    python benchmarks/servoing.py                 # 100 starts, right and wrong, 100 grasps
    python benchmarks/servoing.py --seeds 2 --starts 2 --grasps 2 --control image hybrid

Every cell's wrist camera is calibrated from rendered pictures. Wrong: focal length by 10 %, mounting by 5 deg. Grasps:
belt at 0 to 0.2 m/s, the cube turning at up to 30 deg/s.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from calibrant.studies.conveyor_cell import conveyor_study
from calibrant.studies.servo_cell import ServoCase, servo_study


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--starts", type=int, default=10)
    parser.add_argument("--grasps", type=int, default=10, help="in each cell")
    parser.add_argument("--first", type=int, default=100, help="the first cell's number; the tests use small ones")
    parser.add_argument("--control", nargs="*", default=["image"], choices=["image", "position", "hybrid", "planar"])
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.seeds)
    print("| control | focal length, mounting wrong by | arrived | median mm, deg | largest mm, deg | s a run |")
    print("|---|---|---|---|---|---|")
    for control in asked.control:
        for focal, turn in ((0.0, 0.0), (0.1, 5.0)) if asked.starts else ():
            began = time.perf_counter()
            case = ServoCase(control=control, starts=asked.starts, focal_error=focal, hand_eye_deg=turn)
            runs = servo_study(seeds, case).runs
            took = (time.perf_counter() - began) / len(runs)
            errors = np.array([[r.error_mm, r.error_deg] for r in runs if np.isfinite(r.error_mm)])
            middle, most = np.median(errors, axis=0), errors.max(axis=0)
            print(
                f"| {control} | {100 * focal:.0f} %, {turn:.0f} deg | {sum(r.passed for r in runs)} of {len(runs)} | "
                f"{middle[0]:.3f}, {middle[1]:.4f} | {most[0]:.3f}, {most[1]:.4f} | {took:.1f} |",
                flush=True,
            )
            for r in runs:
                if not r.passed:
                    print(f"  seed {r.seed}, start {r.start}: {r.reason} {r.error_mm:.3f} mm {r.error_deg:.4f} deg")
    if asked.grasps:
        passed = conveyor_study(seeds, trials=asked.grasps)
        off = np.median([p.off_mm for p in passed if p.held])
        print(f"grasps on the move: {sum(p.held for p in passed)} of {len(passed)} held, median {off:.1f} mm off")
        for p in passed:
            if not p.held:
                print(f"  seed {p.seed}, {p.trial}: {p.speed_m_s:.3f} m/s, {p.turn_deg_s:.0f} deg/s: {p.reason}")


if __name__ == "__main__":
    main()
