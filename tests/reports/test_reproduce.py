"""How to make a result again: the command line that is told, versions, hashes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from calibrant.data import CalibrationResult
from calibrant.reports.reproduce import reproduced


def told(result: CalibrationResult) -> dict[str, str]:
    return {row[0]: row[1] for row in reproduced(result).rows}


def test_the_command_of_a_camera(intrinsics_result: CalibrationResult) -> None:
    files = tuple({"file": f"photos/{i}.png", "sha256": "ab" * 32} for i in range(13))
    rows = told(replace(intrinsics_result, inputs=files))
    photos = "photos/0.png … photos/12.png"
    assert rows["command"] == f"calibrant intrinsics {photos} --target chessboard:9x6:30mm --model brown --fix k3"
    assert rows["install"] == "pip install calibrant==0.1.0"
    assert "numpy" in rows["this page"]


def test_photos_go_by_their_cameras_and_poses_apart(
    intrinsics_result: CalibrationResult, hand_eye_result: Callable[[str], CalibrationResult]
) -> None:
    arm = hand_eye_result("eye-to-hand")
    files = ({"file": "0.png", "sha256": ""}, {"file": "my poses.csv", "sha256": ""})
    assert "--images 0.png --poses 'my poses.csv'" in told(replace(arm, inputs=files))["command"]
    seen = intrinsics_result.observations
    assert seen is not None
    views = tuple(replace(v, camera=c, file=f"{c}/{c}{v.id}") for c in ("left", "right") for v in seen.views[:2])
    pair = replace(
        intrinsics_result,
        kind="stereo",
        views=(),
        observations=replace(seen, views=views, image_sizes={"left": (1280, 1024), "right": (1280, 1024)}, missed=()),
        inputs=tuple({"file": v.file or "", "sha256": ""} for v in views),
        options={"reference": "left"},
    )
    assert told(pair)["command"].startswith(
        "calibrant stereo --left left/left0.png left/left1.png --right right/right0.png"
    )
    assert "reference" not in told(pair)["command"]


def test_a_kind_whose_files_are_not_told_apart_has_no_command() -> None:
    assert "command" not in told(CalibrationResult("depth", "ok"))
