"""Pushed half way: named with its size and place, and neither noise nor a drift is."""

from __future__ import annotations

import numpy as np
import pytest

import calibrant as cb
from calibrant.arrays import Array
from calibrant.calibrate.cell.calibrate import fit_cell
from calibrant.calibrate.cell.certainty.moved import Moved
from calibrant.calibrate.cell.certainty.moved_check import moved_check
from calibrant.calibrate.cell.checks import views_check
from calibrant.calibrate.cell.problem.layout import ONLY_ROBOT, Pictures, TargetPoses
from calibrant.data import Check, ViewResult
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import hand_eye_scene

POSES, AT = 20, 8
PUSH = se3.make(so3.exp(np.array([0.002, -0.001, 0.003])), np.array([1.5e-3, 1e-3, -1e-3]))
LEVEL = np.array([np.deg2rad(0.02)] * 3 + [2e-4] * 3)


def _found(seed: int, pushes: Array, *, on_flange: bool = False) -> tuple[Moved | None, Check | None, Array]:
    """What is found where pose i sees its target after the push i (n, 4, 4), and where the pushed thing is, (3,)."""
    scene, rng = hand_eye_scene("exact", views=POSES, seed=seed), np.random.default_rng(seed)
    true = scene.T_base_gripper
    A = true @ pushes if on_flange else se3.inverse(pushes) @ true
    ids = tuple(str(i) for i in range(POSES))
    Z = true[0] @ scene.X @ scene.T_camera_target[0]
    B = se3.inverse(A @ scene.X) @ Z
    said = se3.retract(true, LEVEL * rng.normal(size=(POSES, 6)))
    pictures = [Pictures("camera", "eye-in-hand", TargetPoses(ids, B))]
    fit = fit_cell(cb.RobotPoses(ids, said), pictures)
    found = fit.certainty.poses.moves.get(ONLY_ROBOT)
    check = None if found is None else moved_check(fit.cell, fit.noise.solution, ONLY_ROBOT, found)
    return found, check, (scene.X if on_flange else Z)[:3, 3]


@pytest.mark.parametrize("on_flange", [False, True], ids=["the board", "the camera"])
def test_a_push_is_named_with_its_place_and_size(on_flange: bool) -> None:
    after = np.arange(POSES) >= AT
    found, check, place = _found(3, np.where(after[:, None, None], PUSH, np.eye(4)), on_flange=on_flange)
    assert found is not None
    assert check is not None
    assert (found.first, found.standing) == (AT, not on_flange)
    what = "the camera on the flange" if on_flange else "the board or the robot's stand"
    assert check.message.startswith(f"{what} moved between 7 and 8 by")
    way, covariance = found.at(place)
    went = se3.apply(PUSH, place) - place
    off = min(way - went, way + went, key=lambda d: float(np.linalg.norm(d)))
    assert off @ np.linalg.solve(covariance, off) < 16.3  # 99.9 %
    assert check.value == pytest.approx(1e3 * np.linalg.norm(went), abs=0.4)


def test_views_left_out_in_one_stretch_are_said_to_be() -> None:
    views = [ViewResult(str(i), i < 15, 40) for i in range(20)]
    check = views_check(views)
    assert check.status == "warn"
    assert (
        "the last 5 in one stretch: did the camera, the board or the robot's stand move between 14 and 15"
        in check.message
    )
    spread = [ViewResult(str(i), i not in (3, 4, 9, 18, 19), 40) for i in range(20)]
    assert views_check(spread).status == "ok"
    assert views_check([ViewResult(str(i), i > 0, 40) for i in range(20)]).status == "ok"


@pytest.mark.long
def test_neither_noise_nor_an_even_drift_nor_a_small_push_is_one() -> None:
    none = np.tile(np.eye(4), (POSES, 1, 1))
    even = np.array([se3.retract(np.eye(4), a * se3.local(np.eye(4), PUSH)) for a in np.linspace(0, 1, POSES)])
    for seed in (0, 1, 2):
        assert _found(seed, none)[0] is None
        assert _found(seed, even)[0] is None
