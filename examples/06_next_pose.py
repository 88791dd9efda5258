"""Five photos are taken: where should the robot go for the next three, so that the camera is known best?"""

from __future__ import annotations

import csv
import tempfile
from pathlib import Path

import calibrant as cb
from calibrant.simulate.cell import make_cell, observe_cell

with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    cell = make_cell(0, views=5)
    result = cb.calibrate_hand_eye(cell.robot_poses, observe_cell(cell, sigma_px=0.1), setup=cell.setup)
    result.write(folder / "hand-eye.json")
    print(f"after {len(cell.robot_poses)} photos: {result.check('certainty').message}\n")

    cb.next_pose(
        robot="ur5e",
        result=folder / "hand-eye.json",
        target=cell.target.spec,
        distance="320mm:600mm",
        count=3,
        out=folder / "plan.csv",
    )
    with (folder / "plan.csv").open(encoding="utf-8") as file:
        plan = list(csv.DictReader(file))

for row in plan:
    place = ", ".join(f"{1e3 * float(row[axis]):.0f}" for axis in "xyz")
    print(f"go to ({place}) mm: then 1 sigma of a seen point is {float(row['sigma_mm']):.3f} mm")
