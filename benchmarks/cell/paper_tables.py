"""The paper's experiment in simulated cells: medians, and how many errors are inside what was predicted.

As `calibrant study paper-tables --cell --seeds N`, for seeds that tests do not use. Exits with 1 where a median or a
row's count is not as promised: 0.5 mm, 0.3 deg (camera fixed), 1 mm, 0.5 deg (moved), 17 of 20 inside.

    nice -n 10 python benchmarks/cell/paper_tables.py --seeds 20 --first-seed 0
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from calibrant.simulate.robot_cell import make_robot_cell
from calibrant.studies.paper import page, published
from calibrant.studies.paper.tables import run_tables, summary, tables_text, verdict


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--readings", type=int, default=6)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--plot", type=Path)
    asked = parser.parse_args()
    seeds = range(asked.first_seed, asked.first_seed + asked.seeds)
    began = time.process_time()

    def step(done: int, total: int, name: str) -> None:
        print(f"{name}: {done} of {total}, {time.process_time() - began:.0f} s of CPU", file=sys.stderr)

    found = run_tables(seeds, make_robot_cell, readings=asked.readings, step=step)
    print("| row | error in the camera, mm, deg | in the base, mm, deg | predicted 95 %, mm, deg | inside |")
    print("|---|---|---|---|---|")
    for row in published.ROWS:
        print(_line(row, *(page.row_medians(found.rows(frame, row)) for frame in ("camera", "base"))))
    for seed, reason in found.failures.items():
        print(f"seed {seed} failed: {reason}")
    print(f"\n{verdict(found)}")
    if asked.json is not None:
        asked.json.write_text(tables_text(found), encoding="utf-8")
    if asked.plot is not None:
        asked.plot.write_bytes(page.tables_png(found))
    s = summary(found)
    return 0 if s is not None and s.kept and not found.failures else 1


def _line(row: str, camera: page.RowMedians, base: page.RowMedians) -> str:
    return (
        f"| {row} | {camera.error_mm:.3f}, {camera.error_deg:.3f} | {base.error_mm:.3f}, {base.error_deg:.3f} | "
        f"{base.predicted_95_mm:.2f}, {base.predicted_95_deg:.2f} | {base.inside} of {base.count} |"
    )


if __name__ == "__main__":
    sys.exit(main())
