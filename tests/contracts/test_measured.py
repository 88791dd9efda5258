"""The README's table "Measured" says what comes out today: each figure to the last digit printed, or next to it."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.calibrate.test_fisheye_data import load, rms

import calibrant as cb

README = (Path(__file__).resolve().parents[2] / "README.md").read_text(encoding="utf-8")
NUMBER = r"(-?\d+(?:\.\d+)?)"


def row(name: str) -> str:
    """The second column of the row whose first begins like this."""
    (found,) = re.findall(rf"^\| {re.escape(name)}[^|]*\| (.*) \|$", README, re.M)
    return str(found)


def says(text: str, pattern: str, *values: float) -> None:
    """The figures at the places of `#` in a pattern are these values, within one and a half of the last digit."""
    match = re.search("".join(NUMBER if c == "#" else re.escape(c) for c in pattern), text)
    assert match is not None, f"{pattern!r} is not in {text!r}"
    for written, value in zip(match.groups(), values, strict=True):
        digit = 10.0 ** -len(written.partition(".")[2])
        assert abs(float(written) - value) < 1.5 * digit, f"{pattern}: {written} is written, {value:.6g} comes out"


def test_the_stereo_set(shared_data: Callable[[str], Path]) -> None:
    text, folder = row("OpenCV's stereo set"), shared_data("opencv_stereo_9x6")
    left, right = (
        cb.intrinsics(sorted(folder.glob(f"{side}*.jpg")), target="chessboard:9x6:25mm") for side in ("left", "right")
    )
    says(text, "# of # boards", sum(v.used for v in (*left.views, *right.views)), len(left.views) + len(right.views))
    says(text, "# px (left) and # px (right) RMS", left.rms_px, right.rms_px)
    says(text, "fx # ± # px", left.camera.parameters["fx"], left.camera.sigma["fx"])


def test_the_board_on_a_wrist(shared_data: Callable[[str], Path]) -> None:
    text, folder = row("ChArUco on a wrist"), shared_data("handeye_rct_charuco_static")
    result = cb.hand_eye(
        images=sorted((folder / "images").iterdir()), poses=sorted((folder / "poses").iterdir()),
        target="charuco:5x7:36.195mm:18.256mm:DICT_6X6_250",
    )  # fmt: skip
    assert [len(v) for v in result.observations.views] == [24] * 12
    says(text, "all # corners in # of 12", 24, len(result.observations.views))
    says(text, "camera at (#, #, #) mm", *1e3 * result.transform("base", "camera").matrix[:3, 3])
    joint = result.methods["joint"]
    says(text, "loop # mm / #°", joint.loop_rms_mm, joint.loop_rms_deg)
    assert sum(not v.used for v in result.views) == 1
    assert "one weak view left out" in text


def test_the_pose_pairs(shared_data: Callable[[str], Path]) -> None:
    text, file = row("50 pose pairs"), shared_data("handeye_moveit_poses") / "pose_samples.json"
    camera = cb.hand_eye(poses=file).transform("base", "camera")
    says(text, "camera at (#, #, #) ± (#, #, #) mm", *1e3 * camera.matrix[:3, 3], *camera.sigma_translation_mm)
    with pytest.raises(cb.RefusedError):
        cb.hand_eye(poses=file, setup="eye-in-hand")


def test_the_fisheye(shared_data: Callable[[str], Path]) -> None:
    text, folder = row("185° fisheye"), shared_data("fisheye_babelcalib_ov_plane")
    train, test = load(folder, "train"), load(folder, "test")
    unified, radial = (cb.calibrate_intrinsics(train, model=m).camera for m in ("unified", "kannala_brandt"))
    says(text, "unified # px, Kannala-Brandt # px", rms(unified, train), rms(radial, train))
    says(text, "unseen photos # and # px", rms(unified, test), rms(radial, test))


def test_the_positioner(shared_data: Callable[[str], Path]) -> None:
    text = row("2-axis positioner")
    file = shared_data("kinematic_rct_positioner") / "positioner_kinematic_measurements.yaml"
    after = cb.kinematics(measurements=file).figures
    says(text, "# mm / #° with two free axes", after["rms_after_mm"].value, after["rms_after_deg"].value)
    assert np.isfinite(after["rms_before_mm"].value)
