"""`calibrant rig` on four webcams' videos of a board that is printed inverted, beside what caliscope 0.11.8 says."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

import calibrant as cb
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.data.details import CameraClocks

pytestmark = pytest.mark.long
SPEC = "charuco:4x5:54mm:40.5mm:DICT_4X4_1000"
"""As the board's file has it, but for the word that says that it is a negative."""


def cameras(session: Path, folder: Path) -> dict[str, str]:
    """The lenses of camera_array.toml as files."""
    stated = tomllib.loads((session / "camera_array.toml").read_text())
    out = {}
    for entry in stated.get("cameras", stated).values():
        if "matrix" not in entry:
            continue
        K, terms = entry["matrix"], dict(zip(("k1", "k2", "p1", "p2", "k3"), entry["distortions"]))
        focal = {"fx": K[0][0], "fy": K[1][1], "cx": K[0][2], "cy": K[1][2]}
        width, height = entry["size"]
        camera = Camera.create("brown", {**focal, **terms}, image_size=(width, height))
        name = f"cam_{entry['cam_id']}"
        CalibrationResult("intrinsics", "ok", cameras={"camera": camera}).write(folder / f"{name}.json")
        out[name] = str(folder / f"{name}.json")
    return out


@pytest.mark.parametrize("table", [False, True])
@pytest.mark.parametrize(
    ("name", "their_rms_px"), [("charuco_calibration", 1.112), ("post_optimization", 1.252)]
)  # fmt: skip
def test_offsets_explain_what_caliscope_leaves(
    name: str, their_rms_px: float, table: bool, shared_data: Callable[[str], Path], tmp_path: Path
) -> None:
    session = shared_data("multicam_caliscope_charuco") / name
    videos = {f"cam_{c}": str(session / "calibration/extrinsic" / f"cam_{c}.mp4") for c in range(4)}
    times = {"times": session / "calibration/extrinsic/timestamps.csv"} if table else {}
    result = cb.rig(images=videos, target=SPEC, camera=cameras(session, tmp_path), time_offsets=True, **times)
    seen = result.observations
    assert seen is not None
    assert any("negative" in note for note in seen.notes)
    assert result.rms_px is not None
    assert result.rms_px < their_rms_px
    held, there = (result.figures[k].value for k in ("held-out RMS", "RMS there in the fit"))
    assert held < 1.1 * there
    clocks = result.detail(CameraClocks)
    assert clocks is not None
    for clock in clocks.clocks:
        assert clock.offset_ms is not None
        assert clock.offset_sigma_ms is not None
        assert 0 < clock.offset_sigma_ms < 10
        # Between the frames of 6 a second: half a period is the most that frames of one number may be apart.
        assert abs(clock.offset_ms) < 100
