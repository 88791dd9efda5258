"""The doctor's options for two cameras: what goes together and what does not."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import calibrant as cb
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.simulate.render import render
from calibrant.simulate.scenes import look_at_board
from calibrant.targets.registry import parse_target

TARGET = "chessboard:7x5:30mm"
CAMERA = Camera.create("pinhole", {"fx": 420.0, "fy": 420.0, "cx": 159.5, "cy": 119.5}, image_size=(320, 240))
T_LEFT_RIGHT = se3.make(so3.exp([0.01, -0.03, 0.0]), [0.06, 0.0, 0.0])


def write_pair(folder: Path, *, count: int, late: int) -> None:
    """Pictures of both sides, the right ones `late` places late."""
    target, rng = parse_target(TARGET), np.random.default_rng(4)
    T = look_at_board(CAMERA, target.points, count + late, rng=rng, distance=(0.5, 0.7), tilt_deg=30)
    for side, first, place in (("left", late, np.eye(4)), ("right", 0, T_LEFT_RIGHT)):
        (folder / side).mkdir()
        for k in range(count):
            picture = render(target.artwork(), CAMERA, se3.inverse(place) @ T[first + k], rng=rng)
            cv2.imwrite(str(folder / side / f"{k:02d}.png"), picture)


@pytest.mark.long
def test_a_pair_out_of_step_is_named_and_calibrated_in_step(tmp_path: Path) -> None:
    write_pair(tmp_path, count=8, late=1)
    given = {"left": tmp_path / "left", "right": tmp_path / "right", "target": TARGET}
    found = cb.doctor(**given)
    assert found.kind == "doctor"
    assert [c.name for c in found.checks if c.status == "fail"] == ["pairs-shifted"]
    result = cb.doctor(**given, apply=True)
    assert result.kind == "stereo"
    assert result.checks[0].message.startswith("repaired: right's pictures come one place too late")
    assert np.linalg.norm(result.transform("left", "right").matrix[:3, 3]) == pytest.approx(0.06, abs=2e-3)


def test_options_that_do_not_go_together_are_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"poses is missing: .* or left and right"):
        cb.doctor(target=TARGET)
    with pytest.raises(InputError, match="leave out poses"):
        cb.doctor(left="left", right="right", poses="poses.csv", target=TARGET)
    with pytest.raises(InputError, match="target, such as"):
        cb.doctor(left="left", right="right")
    with pytest.raises(InputError, match="no images of the right camera"):
        cb.doctor(left="left", target=TARGET)
