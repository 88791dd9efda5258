"""Sigma of an identified arm whose measurements err like their neighbours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.calibrate.kinematics.identify import calibrate_kinematics
from calibrant.calibrate.kinematics.shared_errors import joint_regions
from calibrant.geometry import se3
from calibrant.robots.arms import arm
from calibrant.simulate.robot_errors import measure, simulate_arm
from calibrant.simulate.truth import chi_square


def _normalised(drift_mm: float, seeds: int, *, poses: int = 60) -> tuple[float, float]:
    """Mean e^T C^-1 e over 6 of the tool at a new pose, and its mean sigma; drift: what a whole run walks away."""
    errors, sigmas = [], []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        simulated = simulate_arm(arm("ur5e"), rng, sigma_mm=0.5, sigma_deg=0.1)
        joints = simulated.draw_joints(rng, poses)
        measured = measure(simulated, joints, rng, sigma_mm=0.05, sigma_deg=0.01)
        walk = np.cumsum(rng.normal(size=(poses, 3)), axis=0) / np.sqrt(poses)
        measured = replace(measured, positions=measured.positions + 1e-3 * drift_mm * (walk - walk.mean(axis=0)))
        found = calibrate_kinematics(measured, simulated.nominal)
        new = simulated.draw_joints(rng, 1)
        T, J = found.model.linearize(new)
        C = J[0] @ found.covariance @ J[0].T
        errors.append(chi_square(se3.local(T, simulated.tool(new))[0], C) / 6)
        sigmas.append(1e3 * np.sqrt(np.trace(C[3:, 3:])))
    return float(np.mean(errors)), float(np.mean(sigmas))


def test_regions_hold_like_joints() -> None:
    rng = np.random.default_rng(0)
    order = rng.permutation(40)
    place = np.repeat(np.arange(4), 10)[order]
    joints = rng.normal(size=(40, 3)) + 10 * place[:, None]
    labels = joint_regions(joints, 4)
    assert len({(int(a), int(b)) for a, b in zip(labels, place)}) == 4


@pytest.mark.statistics
def test_a_measuring_device_that_drifts_is_in_sigma() -> None:
    clean, sigma = _normalised(0.0, 30)
    assert clean < 1.4
    drifting, wider = _normalised(0.3, 30)
    assert drifting < 2.0
    assert wider > 1.2 * sigma
