"""Two lines of the pose file stand in each other's place: the doctor says so, and calibrates from a repaired copy."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

import calibrant as cb
from calibrant.simulate.cell import make_cell, photograph

with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    cell = make_cell(2, views=10)
    photograph(cell, folder)
    header, *lines = (folder / "poses.csv").read_text(encoding="utf-8").splitlines()
    names, numbers = zip(*(line.split(",", 1) for line in lines))
    order = [0, 1, 2, 8, 4, 5, 6, 7, 3, 9]  # 3 and 8 exchanged
    wrong = folder / "pasted-wrong.csv"
    wrong.write_text("\n".join([header, *(f"{n},{numbers[k]}" for n, k in zip(names, order))]), encoding="utf-8")
    given = {"images": folder / "images", "poses": wrong, "target": cell.target.spec, "cache": folder}

    diagnosis = cb.doctor(**given)
    for check in diagnosis.checks:
        if check.status != "ok":
            print(f"{check.status}: {check.name}: {check.message}")

    repaired = cb.doctor(**given, apply=True, repaired_poses=folder / "repaired.csv")
    again = (folder / "repaired.csv").read_text(encoding="utf-8").splitlines()
    print(f"\nrepaired.csv has {len(again) - 1} poses; 03.png: {again[4].split(',', 1)[1][:32]} …")
    print(f"the robot was really there:       {numbers[3][:32]} …")

camera = repaired.transform("gripper", "camera")
off = 1e3 * (camera.matrix[:3, 3] - cell.X[:3, 3])
print(f"\nverdict {repaired.verdict}; the camera is off the truth by {np.round(off, 3)} mm")
print(f"1 sigma {np.round(camera.sigma_translation_mm, 3)} mm")
