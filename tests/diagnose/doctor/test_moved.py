"""The quick look at every place where something may have moved."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from calibrant.diagnose.doctor import Case
from calibrant.diagnose.doctor.faults import moved
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import hand_eye_scene

CaseOf = Callable[..., Case]


@pytest.mark.parametrize("counted", [40, moved.MOST_COUNTED])
@pytest.mark.parametrize("n", [7, 24, 61])
def test_medians_before_and_from_every_place(monkeypatch: pytest.MonkeyPatch, n: int, counted: int) -> None:
    """Those of NumPy, to the last digit: in one go and place by place, with equal values among them."""
    monkeypatch.setattr(moved, "MOST_COUNTED", counted)
    d = np.random.default_rng(n).normal(size=(n, 6)).round(1)
    places = np.arange(3, n - 2)
    before, after = moved._medians(d, places)
    np.testing.assert_array_equal(before, [np.median(d[:k], axis=0) for k in places])
    np.testing.assert_array_equal(after, [np.median(d[k:], axis=0) for k in places])


@pytest.mark.parametrize(("off_mm", "apart", "status"), [(2.4, True, "warn"), (2.4, False, "fail"), (20, True, "fail")])
def test_a_posture_of_its_own_may_be_the_arms_error(pairs: CaseOf, off_mm: float, apart: bool, status: str) -> None:
    """Three views alone with the tool turned far from the others, all off alike: the arm, or a move."""
    scene, rng = hand_eye_scene("good", views=16), np.random.default_rng(0)
    T = scene.robot_poses.T_base_gripper.copy()
    if apart:
        T[:3, :3, :3] = so3.exp([2.5, 0.2, 0.9]) @ T[0, :3, :3]
    B = se3.inverse(scene.X) @ se3.inverse(T) @ scene.Z
    B = se3.retract(B, rng.normal(scale=2e-4, size=(16, 6)))
    T[:3, :3, 3] += 1e-3 * off_mm * np.array([0.48, 0.6, 0.64])
    found = [f for f in moved.examine(pairs(scene, T=T, B=B)) if f.name.endswith("-moved")]
    assert [f.status for f in found] == [status]
    assert (found[0].repair is None) == (status == "warn")
