"""Interaction matrices against central differences of projected points."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.geometry import se3, so3
from calibrant.servoing.sight.interaction import log_depth_row, point_rows, shift_rows, turn_rows
from calibrant.servoing.sight.mounting import Mounting, Setup

P = np.array([[0.1, -0.05, 0.4], [-0.2, 0.1, 0.7], [0.02, 0.15, 0.5]])
STEP = 1e-6


def differences(of):
    """d of(T) / d twist, T the camera's motion from where it is, body axes."""
    columns = []
    for k in range(6):
        xi = np.zeros(6)
        xi[k] = STEP
        columns.append((of(se3.exp(xi)) - of(se3.exp(-xi))) / (2 * STEP))
    return np.stack(columns, axis=-1)


def test_points_and_depth_move_as_differences_say() -> None:
    def normalised(T):
        p = se3.apply(se3.inverse(T), P)
        return (p[:, :2] / p[:, 2:]).ravel()

    xy, depth = P[:, :2] / P[:, 2:], P[:, 2]
    np.testing.assert_allclose(point_rows(xy, depth), differences(normalised), atol=1e-7)
    log_depth = differences(lambda T: np.log(se3.apply(se3.inverse(T), P)[:, 2]))
    for i in range(3):
        np.testing.assert_allclose(log_depth_row(xy[i], depth[i]), log_depth[i], atol=1e-7)


def test_turn_and_shift_move_as_differences_say() -> None:
    start = se3.make(so3.exp([0.7, -0.4, 1.1]), [0.1, 0.2, -0.3])
    turn = differences(lambda T: so3.log((start @ T)[:3, :3]))
    shift = differences(lambda T: (start @ T)[:3, 3])
    np.testing.assert_allclose(turn_rows(start[:3, :3]), turn, atol=1e-7)
    np.testing.assert_allclose(shift_rows(start[:3, :3]), shift, atol=1e-7)


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_the_flange_moves_the_camera_against_its_target_as_differences_say(setup: Setup) -> None:
    T_base_gripper = se3.make(so3.exp([0.3, 0.9, -0.2]), [0.4, -0.1, 0.3])
    mounting = Mounting(setup, se3.make(so3.exp([-0.5, 0.2, 0.8]), [0.1, -0.05, 0.2]))
    target = se3.make(so3.exp([0.2, 0.1, 0.4]), [0.05, 0.3, 0.1])

    def relative(delta):
        T = se3.retract(T_base_gripper, delta)
        held = target if setup == "eye-in-hand" else T @ target
        return se3.inverse(held) @ mounting.T_base_camera(T)

    here = relative(np.zeros(6))
    columns = []
    for k in range(6):
        d = np.zeros(6)
        d[k] = STEP
        columns.append(se3.log(se3.inverse(here) @ relative(d)) - se3.log(se3.inverse(here) @ relative(-d)))
    np.testing.assert_allclose(
        mounting.camera_from_flange(T_base_gripper), np.stack(columns, axis=-1) / (2 * STEP), atol=1e-7
    )
