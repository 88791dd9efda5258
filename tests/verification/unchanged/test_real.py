"""Real sets: calibrated without three photos, these show that nothing changed; moved by numbers, that it did."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.data import CalibrationResult
from calibrant.geometry import se3
from calibrant.verification.unchanged.compare import on_robot, seen_now
from calibrant.verification.unchanged.decide import CAMERA, Decision
from calibrant.verification.unchanged.robot_noise import robot_side
from calibrant.verification.unchanged.spread import spread_of

SETS = {
    "handeye_rct_charuco_static": ("charuco:5x7:36.195mm:18.256mm:DICT_6X6_250", "eye-to-hand"),
    "handeye_rct_circles_eih": ("circles:10x10:25.4mm:bigdot", "eye-in-hand"),
}


def without(full: CalibrationResult, out: list[str], setup: str, push: np.ndarray | None = None) -> Decision:
    """The decision about the photos `out` against the calibration from all others; push: of the camera, since."""
    assert full.observations is not None
    assert full.robot_poses is not None
    views = [v for v in full.observations.views if v.moment in full.robot_poses.ids]
    rest = replace(full.observations, views=tuple(v for v in views if v.id not in out))
    said = full.robot_poses
    moved = {v.id: v.moment for v in views}
    known = cb.calibrate_hand_eye(said.only(v.moment for v in rest.views), rest, setup=setup)  # type: ignore[arg-type]
    seen = seen_now(known.camera, [v for v in views if v.id in out])
    if push is not None:
        views_now = tuple(
            replace(
                v, uv=known.camera.project(se3.apply(se3.inverse(push) @ T, v.points)) - v.residuals(known.camera, T)
            )
            for v, T in zip(seen.views, seen.T_camera_target)
        )
        seen = seen_now(known.camera, views_now)
    poses = said.only([moved[v.id] for v in seen.views]).T_base_gripper
    side, spread = robot_side(known, "camera"), spread_of(known, "camera", known.camera)
    return on_robot(known.camera, side, seen, poses, spread).decision


@pytest.mark.long
@pytest.mark.parametrize("name", SETS)
def test_photos_that_were_kept_out_are_unchanged(name: str, shared_data: Callable[[str], Path]) -> None:
    folder = shared_data(name)
    spec, setup = SETS[name]
    full = cb.hand_eye(images=str(folder / "images"), poses=str(folder / "poses"), target=spec)
    ids = [v.id for v in full.views if v.T_camera_target is not None]
    for start in range(0, len(ids) - 2, 5):
        out = ids[start : start + 3]
        assert not without(full, out, setup).changed, out
    # The robot of the second set errs by 10 mm: a push that is to be seen is larger. What it errs by alike it errs by
    # now too: 0.12 m is left to a chance of 2e-4 (2.6e-3 where its share in the sigma of camera and target were noise).
    push = se3.make(np.eye(3), [0.12 if setup == "eye-in-hand" else 0.012, 0.0, 0.0])
    found = without(full, ids[3:6], setup, push)
    assert found.changed
    assert CAMERA in [h.what for h in found.explaining]
