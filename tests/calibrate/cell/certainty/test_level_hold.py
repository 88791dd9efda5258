"""Levels that the data hardly tell are held at what they may be."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.calibrate.cell.calibrate import fit_cell
from calibrant.calibrate.cell.certainty.level_hold import held_share
from calibrant.calibrate.cell.problem.groups import robot_groups
from calibrant.calibrate.cell.problem.layout import ONLY_ROBOT, Pictures
from calibrant.data import RobotPoses
from calibrant.simulate.cell import make_cell, observe_cell
from calibrant.simulate.noise import noisy_poses


def test_the_share_is_the_mean_of_what_is_positive() -> None:
    rng = np.random.default_rng(0)
    for s in (0.2, 1.0, 5.0):
        draws = 1 + s * rng.normal(size=400_000)
        assert held_share(s) == pytest.approx(draws[draws > 0].mean(), rel=0.01)
    assert held_share(0.05) == pytest.approx(1.0)
    assert held_share(1e3) == pytest.approx(0.798e3, rel=0.01)


@pytest.mark.statistics
def test_the_robots_millimetres_do_not_collapse() -> None:
    shares = []
    for seed in range(40):
        cell, rng = make_cell(seed, views=12), np.random.default_rng(seed)
        # Turns of 0.02 degrees at half a metre outweigh positions of 0.03 mm.
        T = noisy_poses(cell.T_base_gripper, sigma_mm=0.03, sigma_deg=0.02, rng=rng)
        pictures = [Pictures("camera", "eye-in-hand", observe_cell(cell, sigma_px=0.2))]
        fit = fit_cell(RobotPoses(cell.robot_poses.ids, T), pictures)
        shares.append(fit.noise.levels[robot_groups(ONLY_ROBOT)[1]].sigma / 0.03e-3)
    assert np.mean(np.array(shares) < 0.5) <= 0.05
