"""Half and more of the poses wrong: how many agree is said, and those are the right ones."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.calibrate.cell.starts.robust import agreeing_group
from calibrant.calibrate.solvers.setup import get_setup
from calibrant.data import RobotPoses
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import HandEyeScene, hand_eye_scene


def with_wrong_poses(views: int, wrong: int, seed: int) -> tuple[HandEyeScene, np.ndarray, np.ndarray]:
    """A scene, its robot poses with some of them elsewhere in the same room, and which are right."""
    scene, rng = hand_eye_scene("good", views=views, seed=seed), np.random.default_rng(seed)
    T, out = scene.robot_poses.T_base_gripper.copy(), rng.choice(views, wrong, replace=False)
    R = so3.exp(rng.normal(scale=0.4, size=(wrong, 3))) @ T[out, :3, :3]
    T[out] = se3.make(R, T[out, :3, 3] + rng.normal(scale=0.1, size=(wrong, 3)))
    return scene, T, ~np.isin(np.arange(views), out)


@pytest.mark.parametrize(("views", "wrong"), [(16, 8), (30, 15), (30, 18)])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_right_ones_are_found(views: int, wrong: int, seed: int) -> None:
    scene, T, right = with_wrong_poses(views, wrong, seed)
    group = agreeing_group(get_setup(scene.setup).normal_form(T), scene.measured_T_camera_target)
    assert group is not None
    assert not (group.members & ~right).any()
    assert group.members.sum() >= right.sum() - 1  # the farthest of fifteen may be taken for a wrong one
    assert group.mm < 0.5


def test_nothing_agrees_in_unrelated_poses() -> None:
    rng = np.random.default_rng(0)
    A, B = (se3.make(so3.random(rng, 20), rng.normal(scale=0.3, size=(20, 3))) for _ in range(2))
    assert agreeing_group(A, B) is None


def test_the_refusal_says_how_many_agree_and_the_way_out() -> None:
    scene, T, right = with_wrong_poses(20, 10, 0)
    poses = RobotPoses.from_matrices(T)
    with pytest.raises(RefusedError, match=r"10 of 20 views agree with each other .* --exclude ") as refused:
        calibrate_hand_eye(poses, scene.measured_T_camera_target, setup=scene.setup)
    left_out = str(refused.value).split("--exclude ")[1].split(",")
    assert left_out == [name for name, good in zip(poses.ids, right) if not good]
    result = calibrate_hand_eye(
        poses.only(np.array(poses.ids)[right].tolist()), scene.measured_T_camera_target[right], setup=scene.setup
    )
    mm, _ = se3.deviation(scene.X, result.transform("gripper", "camera").matrix)
    assert mm < 0.5
