"""Views judged one by one: their certainty, their sharpness, their weights, and what a given camera rules out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.calibrate.cell.photos import judge
from calibrant.calibrate.cell.problem.views import from_observations, from_target_poses, match_views, unsharp_views
from calibrant.data import RobotPoses, View
from calibrant.errors import InputError
from calibrant.simulate.scenes import HandEyeScene, hand_eye_scene


@pytest.fixture(scope="module")
def scene() -> HandEyeScene:
    return hand_eye_scene("good", views=8)


def stated(view: View, sigma_px: float) -> View:
    return replace(view, sigma_px=np.full(len(view), sigma_px))


def test_target_poses_and_their_uncertainty(scene: HandEyeScene) -> None:
    data = from_observations(scene.robot_poses, scene.observations, scene.camera)
    assert data.sigma_px == pytest.approx(0.1, rel=0.1)
    error = np.linalg.norm(data.B[:, :3, 3] - scene.T_camera_target[:, :3, 3], axis=1)
    sigma = data.sigma_px * np.sqrt(np.trace(data.covariance[:, 3:, 3:], axis1=1, axis2=2))
    assert np.all(error < 5 * sigma)
    assert np.median(data.certainty) == pytest.approx(1, abs=0.3)


def test_a_weak_view_is_flagged_and_a_useless_one_left_out(scene: HandEyeScene) -> None:
    views = list(scene.observations.views)
    corner = np.isin(np.arange(63), [0, 1, 2, 9, 10, 11, 18, 19, 20])  # 9 points on a twelfth of the area
    views[1] = views[1].subset(corner)
    views[2] = views[2].subset(np.arange(63) < 5)
    data = from_observations(scene.robot_poses, replace(scene.observations, views=tuple(views)), scene.camera)
    assert not data.use[1]
    assert "leave the target's position uncertain" in (data.reasons[1] or "")
    assert data.reasons[2] == "only 5 points, 6 are needed"
    assert dict(data.missing).keys() == {"1", "2"}


def test_unsharp_views_are_named(scene: HandEyeScene) -> None:
    views = [stated(v, 0.04) for v in scene.observations.views]
    views[3] = stated(views[3], 0.09)
    remarks = unsharp_views(views)
    assert set(remarks) == {"3"}
    assert "0.09 px" in remarks["3"]
    assert unsharp_views(scene.observations.views) == {}


def test_excess_noise_completes_the_detectors_sigma(scene: HandEyeScene) -> None:
    """Noise of 0.1 px of which the detector knows 0.02 px in half of the views and 0.06 px in the others."""
    views = [stated(v, 0.02 if i % 2 else 0.06) for i, v in enumerate(scene.observations.views)]
    judged = judge(views, scene.camera)
    low, high = judged.views[1].sigma_px, judged.views[0].sigma_px
    assert low is not None
    assert high is not None
    # Without the excess the ratio of weights would be 9 to 1 for points of the same noise.
    assert 1 < high[0] / low[0] < 1.3
    assert np.sqrt(np.mean([np.mean(v.sigma_px**2) for v in judged.views])) == pytest.approx(0.1, rel=0.05)


def test_views_without_a_stated_sigma_keep_equal_weights(scene: HandEyeScene) -> None:
    assert all(v.sigma_px is None for v in judge(scene.observations.views, scene.camera).views)


def test_gross_points_do_not_count_as_noise(scene: HandEyeScene) -> None:
    views = [stated(v, 0.05) for v in scene.observations.views]
    uv = views[4].uv.copy()
    uv[[2, 30]] += [30.0, -12.0]
    views[4] = replace(views[4], uv=uv)
    judged = judge(views, scene.camera)
    assert [len(v) for v in judged.views] == [63, 63, 63, 63, 61, 63, 63, 63]
    assert judged.views[0].sigma_px == pytest.approx(0.1, rel=0.05)


def test_pairs_are_matched_by_name(scene: HandEyeScene) -> None:
    poses = RobotPoses.from_matrices(scene.T_base_gripper[::-1], ids=[str(i) for i in range(8)][::-1])
    _, rows = match_views(poses, scene.observations)
    assert rows == list(range(8))[::-1]
    with pytest.raises(InputError, match="no robot pose for 8 of 8 views"):
        match_views(RobotPoses.from_matrices(scene.T_base_gripper, ids="abcdefgh"), scene.observations)
    with pytest.raises(InputError, match="8 robot poses but 3 target poses"):
        from_target_poses(poses, scene.T_camera_target[:3])
