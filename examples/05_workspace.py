"""How accurate is a point where the tool works? The 95 % radius in a box of the base, and where it comes from."""

from __future__ import annotations

import tempfile
from pathlib import Path

import calibrant as cb
from calibrant.simulate.cell import make_cell, photograph

BOX = "550mm:700mm,30mm:180mm,0mm:60mm"  # x, y, z in the base
TOLERANCE = "1mm"

with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    cell = make_cell(6, views=10)
    photograph(cell, folder)
    result = cb.hand_eye(
        images=folder / "images",
        poses=folder / "poses.csv",
        target=cell.target.spec,
        workspace=BOX,
        tolerance=TOLERANCE,
        cache="none",
    )

print(result)
print()
for check in result.checks:
    if check.name in ("workspace", "budget", "tolerance"):
        print(f"{check.status}: {check.name}: {check.message}")
