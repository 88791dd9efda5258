"""Symmetric boards seen from all sides, as the commands examine them: numbered before the poses are read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibrant.calibrate.cell.boards.turned import NAME, board_turns, turned_views
from calibrant.data import Observations, RobotPoses
from calibrant.diagnose.doctor.diagnosis import diagnose_views
from calibrant.diagnose.doctor.repair import calibrate_repaired
from calibrant.formats.poses.read import notations, read_poses
from calibrant.geometry.rotations import euler_from_matrix
from calibrant.simulate.cell import poses_csv
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.scenes import Setup, gripper_poses, look_at_board, observe, standard_camera, standard_mounting
from calibrant.simulate.truth import normalised
from calibrant.targets.registry import parse_target

SPEC = "circles:9x7:30mm"


def cell(setup: Setup, seed: int) -> tuple[RobotPoses, Observations, np.ndarray]:
    """Poses, rightly numbered views, and the true X."""
    rng = np.random.default_rng(seed)
    X, Z = standard_mounting(setup)
    points = parse_target(SPEC).points
    B = look_at_board(standard_camera(), points, 15, rng=rng, distance=(0.45, 0.9), tilt_deg=35)
    names = [f"{i}.png" for i in range(15)]
    A = noisy_poses(gripper_poses(setup, X, Z, B), sigma_mm=0.2, sigma_deg=0.05, rng=rng)
    seen = observe(standard_camera(), points, B, sigma_px=0.2, rng=rng)
    views = tuple(replace(v, id=i, moment=i) for v, i in zip(seen.views, names))
    return RobotPoses(names, A), replace(seen, views=views, target=SPEC), X


def half_turned(seen: Observations, rows: list[int]) -> Observations:
    turns = board_turns(seen.target)
    assert turns is not None
    return replace(seen, views=turned_views(seen.views, rows, turns.F[1]))


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_half_of_the_views_turned_is_settled_before_the_notation(setup: Setup, tmp_path: Path) -> None:
    poses, seen, X = cell(setup, 1)
    rows = [0, 2, 3, 7, 9, 11, 14]
    (tmp_path / "poses.csv").write_text(poses_csv(poses))
    complete = notations(read_poses([str(tmp_path / "poses.csv")]))
    found = diagnose_views(complete, half_turned(seen, rows), standard_camera(), camera_given=True)
    assert found.poses.setup == setup
    assert [(f.name, f.status) for f in found.findings if f.status != "ok"] == []
    finding = found.named(NAME)[0]
    assert finding.views == tuple(f"{i}.png" for i in rows)
    assert "7 of 15 views were numbered again" in finding.message
    result = calibrate_repaired(found)
    # chi-square of 6 degrees of freedom at P = 1e-4.
    assert normalised(result.transforms[0], X) < 27.86


def test_right_numbering_says_nothing(tmp_path: Path) -> None:
    poses, seen, _ = cell("eye-in-hand", 2)
    (tmp_path / "poses.csv").write_text(poses_csv(poses))
    complete = notations(read_poses([str(tmp_path / "poses.csv")]))
    found = diagnose_views(complete, seen, standard_camera(), camera_given=True)
    assert found.named(NAME) == ()


def test_euler_angles_of_unknown_order_are_found_beside_the_numbering(tmp_path: Path) -> None:
    poses, seen, _ = cell("eye-in-hand", 3)
    T = poses.T_base_gripper
    angles = euler_from_matrix(T[:, :3, :3], order="XYZ", unit="deg")
    rows = [",".join([n, *(f"{v:.9g}" for v in (*t, *a))]) for n, t, a in zip(poses.ids, T[:, :3, 3], angles)]
    (tmp_path / "poses.csv").write_text("image,x,y,z,a,b,c\n" + "\n".join(rows) + "\n")
    complete = notations(read_poses([str(tmp_path / "poses.csv")]))
    assert len({r.rotation for r in complete}) > 3
    found = diagnose_views(complete, half_turned(seen, [1, 2, 4, 8, 9, 13]), standard_camera(), camera_given=True)
    assert found.poses.notation.rotation == "euler:XYZ"
    assert len(found.named(NAME)[0].views) == 6
    assert found.sound
