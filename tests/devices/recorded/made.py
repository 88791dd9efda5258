"""A small recorded session on disk: pictures whose grey value is their number, depth beside them, poses and joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrant.geometry import so3
from calibrant.opencv import cv2
from calibrant.robots.arms import arm

COUNT = 4
JOINTS = np.deg2rad([180.0, -100.0, 110.0, -100.0, -90.0, 0.0]) + 0.1 * np.arange(COUNT)[:, None] * [
    1,
    0.5,
    -1,
    1,
    1,
    2,
]
POSES = arm("ur5e").forward(JOINTS)


def grey(k: int) -> int:
    return 20 * (k + 1)


def write_pictures(folder: Path, *, depth: str = "") -> None:
    """folder/00.png …; depth: "beside" (00_depth.png, mm), "array" (00.npy, metres), "folder" (depth/00.png)."""
    folder.mkdir(exist_ok=True)
    for k in range(COUNT):
        cv2.imwrite(str(folder / f"{k:02d}.png"), np.full((48, 64, 3), grey(k), np.uint8))
        z = np.full((24, 32), 500 + k, np.uint16)
        z[0, 0] = 0
        if depth == "beside":
            cv2.imwrite(str(folder / f"{k:02d}_depth.png"), z)
        elif depth == "array":
            np.save(folder / f"{k:02d}.npy", 1e-3 * z)
        elif depth == "folder":
            (folder / "depth").mkdir(exist_ok=True)
            cv2.imwrite(str(folder / "depth" / f"{k:02d}.png"), z)


def write_poses(file: Path, *, times: bool = False, names: bool = True, T: NDArray = POSES) -> None:
    """x, y, z in metres and quaternions with named columns."""
    header = [*(["image"] if names else []), *(["timestamp"] if times else []), "x", "y", "z", "qw", "qx", "qy", "qz"]
    rows = [",".join(header)]
    for k, one in enumerate(T):
        q = so3.quaternion_wxyz(one[:3, :3])
        numbers = [repr(float(v)) for v in (*one[:3, 3], *q)]
        rows.append(",".join([*([f"{k:02d}.png"] if names else []), *([str(10 + 0.5 * k)] if times else []), *numbers]))
    file.write_text("\n".join(rows) + "\n")


def write_joints(file: Path) -> None:
    rows = [",".join(["image", *(f"q{i + 1}" for i in range(6))])]
    rows += [",".join([f"{k:02d}.png", *(repr(float(v)) for v in q)]) for k, q in enumerate(JOINTS)]
    file.write_text("\n".join(rows) + "\n")
