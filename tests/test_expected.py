"""Arguments of the wrong kind in Python: an InputError that says what was given and what is expected."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.expected import names_of

BOARD = np.array([[x, y, 0.0] for y in range(3) for x in range(3)]) * 0.03
VIEW = cb.View("0.png", BOARD, 100 + 500 * BOARD[:, :2], np.arange(9))
SEEN = cb.Observations((VIEW,), {"camera": (640, 480)}, "chessboard:3x3:30mm")
POSES = cb.RobotPoses(("0.png",), np.eye(4)[None])
NAMED = {"fx": 1.0, "fy": 1.0, "cx": 0.0, "cy": 0.0}

CALLS: dict[str, tuple[Callable[[], object], str]] = {
    "report": (lambda: cb.write_report(3, "x"), r"the result is 3 \(int\); expected a CalibrationResult"),
    "cell": (lambda: cb.calibrate_cell(3, 4), "robots is 3|pictures is 4"),
    "pictures": (lambda: cb.calibrate_cell(POSES, 4), r"pictures is 4 \(int\); expected a list of Pictures"),
    "one picture": (lambda: cb.calibrate_cell(POSES, [4]), r"one of pictures is 4 \(int\); expected Pictures"),
    "robots": (lambda: cb.calibrate_cell({"a": 3}, [cb.Pictures("camera", "eye-in-hand", SEEN)]), "poses of robot 'a'"),
    "rig": (lambda: cb.calibrate_rig(3), "expected Observations of two cameras"),
    "target": (lambda: cb.detect("x.png", target=3), "target is 3 .*expected a target's spec, such as 'chessboard:9x6"),
    "mirror": (lambda: cb.detect("x.png", target="chessboard:9x6:25mm", mirror_x="no"), "expected True or False"),
    "cache": (lambda: cb.detect("x.png", target="chessboard:9x6:25mm", cache=3), "cache is 3 .*expected a folder"),
    "progress": (lambda: cb.detect("x.png", target="chessboard:9x6:25mm", progress=3), "expected a function"),
    "model": (lambda: cb.calibrate_intrinsics(SEEN, model=3), "model is 3 .*such as 'brown'"),
    "fix": (
        lambda: cb.calibrate_intrinsics(SEEN, fix=3),
        r"fix is 3 \(int\); expected a list of names of parameters or groups",
    ),
    "one fix": (lambda: cb.calibrate_intrinsics(SEEN, fix=[3]), "one of fix is 3"),
    "initial": (lambda: cb.calibrate_intrinsics(SEEN, initial=3), "initial is 3 .*expected a Camera"),
    "known": (lambda: cb.calibrate_hand_eye(POSES, SEEN, setup="eye-in-hand", camera=3), "camera is 3 .*a Camera"),
    "camera": (lambda: cb.Camera.create(3, NAMED, image_size=(3, 3)), "the camera model is 3"),
    "parameters": (lambda: cb.Camera.create("pinhole", 3, image_size=(3, 3)), "parameters is 3 .*values by name"),
    "number": (lambda: cb.Camera.create("pinhole", {**NAMED, "fx": "a"}, image_size=(3, 3)), "parameter 'fx' is 'a'"),
    "size": (lambda: cb.Camera.create("pinhole", NAMED, image_size=3), r"image_size is 3 .*\(width, height\)"),
    "poses": (lambda: cb.RobotPoses(3, np.eye(4)[None]), "ids is 3 .*the names of the poses"),
    "views": (lambda: cb.Observations(3, {}), "views is 3"),
    "view": (lambda: cb.View(3, BOARD, BOARD[:, :2], np.arange(9)), "a view's id is 3"),
}


@pytest.mark.parametrize("name", CALLS)
def test_an_argument_of_the_wrong_kind_is_said(name: str, tmp_path: Path) -> None:
    call, words = CALLS[name]
    with pytest.raises(cb.InputError, match=words):
        call()


def test_names_are_a_list() -> None:
    assert names_of(["k3", "aspect"], "fix", "names") == ("k3", "aspect")
    for alone in ("k3", b"k3", {"k3": 1}, 3):
        with pytest.raises(cb.InputError, match=r"fix is .*; expected names"):
            names_of(alone, "fix", "names")
