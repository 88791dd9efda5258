"""The closed-form start: the most consistent solver, and gross views set aside one by one."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.calibrate.cell.starts.seed import best_seed, compare_methods, mean_of_methods
from calibrant.calibrate.solvers.registry import SOLVERS
from calibrant.errors import RefusedError
from calibrant.geometry import se3
from calibrant.simulate.scenes import hand_eye_scene

SCENE = hand_eye_scene("good", views=9)
A, B = SCENE.robot_poses.T_base_gripper, SCENE.measured_T_camera_target


def test_good_poses_are_all_kept() -> None:
    seed = best_seed(A, B)
    assert seed.keep.all()
    assert np.linalg.norm(seed.X[:3, 3] - SCENE.X[:3, 3]) < 2e-3
    assert seed.method in SOLVERS


def test_gross_views_are_set_aside_and_no_others() -> None:
    wrong = A.copy()
    wrong[2] = A[5]
    wrong[7, :3, 3] += [0.05, 0, 0]
    assert np.flatnonzero(~best_seed(wrong, B).keep).tolist() == [2, 7]


def test_an_uncertain_view_is_given_more_room() -> None:
    wrong = A.copy()
    wrong[4, :3, 3] += [0.003, 0, 0]  # some 15 times the typical deviation
    certainty = np.ones(9)
    certainty[4] = 10
    assert not best_seed(wrong, B).keep[4]
    assert best_seed(wrong, B, certainty=certainty).keep[4]


def test_the_table_has_every_method_and_their_mean() -> None:
    table = compare_methods(A, B)
    assert set(table) == set(SOLVERS)
    mean = mean_of_methods(A, B, table)
    assert mean.matrix is not None
    assert max(np.abs(se3.local(mean.matrix, SCENE.X))) < 5e-3
    assert all(row.loop_rms_mm < 1 for row in table.values() if row.loop_rms_mm is not None)


def test_what_nothing_can_solve_is_refused() -> None:
    still = np.broadcast_to(np.eye(4), (5, 4, 4))
    with pytest.raises(RefusedError):
        best_seed(still, still)
    assert all(row.matrix is None and row.message for row in compare_methods(still, still).values())
