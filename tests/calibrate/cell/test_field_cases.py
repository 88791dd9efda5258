"""Hand-eye data from the field, each with the camera that another method found."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from calibrant.errors import RefusedError
from calibrant.tasks.options.poses import TargetPoseOptions
from calibrant.tasks.robots import hand_eye


def camera_mm(poses: list[Path], target: list[Path] | None, setup: str = "auto", **more: str) -> list[float]:
    """Where the camera is found, mm, in its parent's frame."""
    measured = TargetPoseOptions(target_poses=tuple(map(str, target or ())), **more)
    request = hand_eye.Request(poses=tuple(map(str, poses)), measured=measured, setup=(setup,))
    result = hand_eye.run(request).result
    assert result is not None
    parent = {"eye-in-hand": "gripper", "eye-to-hand": "base"}[str(result.decided["setup"])]
    return [1e3 * float(x) for x in result.transform(parent, "camera").matrix[:3, 3]]


def test_a_wrist_alone(shared_case: Callable[[str], Path]) -> None:
    """All motions turn about one fixed point; the truth is (50, 20, 100) mm, a closed form gives (50.0, 20.0, 99.9)."""
    folder = shared_case("15-wrist")
    found = camera_mm([folder / "wr_robot.csv"], [folder / "wr_cam.csv"], "eye-in-hand")
    assert found == pytest.approx([50, 20, 100], abs=0.5)  # four sigma of 0.13 mm


def test_a_camera_track_in_the_frame_of_its_first_pose(shared_case: Callable[[str], Path]) -> None:
    """Visual odometry on an arm that works above its base; the truth is (50, 20, 100) mm."""
    folder = shared_case("14-odometry")
    for setup in ("eye-in-hand", "auto"):
        found = camera_mm([folder / "vo2_robot.csv"], [folder / "vo2_cam.csv"], setup)
        assert found == pytest.approx([50, 20, 100], abs=0.4)  # four sigma of 0.09 mm


@pytest.mark.parametrize("scale", [0.89, 2.0, 17.3])
def test_a_track_of_unknown_scale(shared_case: Callable[[str], Path], tmp_path: Path, scale: float) -> None:
    """Refused by its cause, whatever the scale; found where it is free, or said."""
    folder = shared_case("14-odometry")
    header, *rows = (folder / "vo2_cam.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows]
    scaled = [",".join([c[0], *(repr(scale * float(x)) for x in c[1:4]), *c[4:]]) for c in cells]
    (tmp_path / "track.csv").write_text("\n".join([header, *scaled]))
    given = [folder / "vo2_robot.csv"], [tmp_path / "track.csv"]
    with pytest.raises(RefusedError, match=f"^target-size: .* {1 / scale:.2f}.* --target-scale free"):
        camera_mm(*given, "eye-in-hand")
    assert camera_mm(*given, target_scale="free") == pytest.approx([50, 20, 100], abs=0.4)
    assert camera_mm(*given, target_scale=repr(1 / scale)) == pytest.approx([50, 20, 100], abs=0.4)


@pytest.mark.parametrize(("setup", "truth"), [("eye-to-hand", [1350, -300, 700]), ("eye-in-hand", [30, 20, 60])])
def test_camera_frames_that_are_not_optical(shared_case: Callable[[str], Path], setup: str, truth: list[float]) -> None:
    """Exact pairs, the camera's x ahead, the marker's z out of its face."""
    found = camera_mm([shared_case("03-not-optical-frames") / f"min2_{setup}.json"], None, setup)
    assert found == pytest.approx(truth, abs=1e-6)


def test_rows_with_the_rotation_first(shared_case: Callable[[str], Path]) -> None:
    """rx ry rz x y z, a file a pose."""
    folder = shared_case("11-rotation-first")
    found = camera_mm(sorted(folder.glob("pos*.txt")), [folder / "target_poses.csv"])
    assert found == pytest.approx([35, -60, 90], abs=0.01)
