"""`calibrant verify depth`: the scale of a depth camera by boards, with a tolerance; what does not belong is named."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.perceive.boxes_on_a_table import d435

import calibrant as cb
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.errors import InputError, RefusedError
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import look_at_board
from calibrant.targets.registry import parse_target

TARGET = "chessboard:7x6:30mm"
CAMERA = Camera.create("pinhole", {"fx": 430.0, "fy": 430.0, "cx": 239.0, "cy": 181.0}, image_size=(480, 360))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three photos, and their depths 2 % too long."""
    out, rng = tmp_path_factory.mktemp("depth"), np.random.default_rng(3)
    target = parse_target(TARGET)
    u, v = np.meshgrid(np.arange(480.0), np.arange(360.0))
    rays = CAMERA.unproject(np.stack([u, v], -1))
    rays = rays / rays[..., 2:]
    for k, T in enumerate(look_at_board(CAMERA, target.points, 3, rng=rng, distance=(0.4, 0.5), tilt_deg=30)):
        image = render(target.artwork(), CAMERA, T, rng=rng, look=Look(clutter=0, noise_grey=2.0))
        cv2.imwrite(str(out / f"c{k}.png"), image)
        z = 1.02 * (T[:3, 2] @ T[:3, 3]) / (rays @ T[:3, 2])
        np.save(out / f"d{k}.npy", d435(np.abs(z), rng, f_b=21.5))
    CalibrationResult("intrinsics", "ok", cameras={"camera": CAMERA}).write(out / "camera.json")
    return out


def _asked(folder: Path, **more: object) -> CalibrationResult:
    given = {
        "depth": [folder / f"d{k}.npy" for k in range(3)],
        "camera": folder / "camera.json",
        "target": TARGET,
    }
    return cb.verify_depth([folder / f"c{k}.png" for k in range(3)], **(given | more))  # type: ignore[arg-type]


def test_two_per_cent_are_found_with_their_sigma(folder: Path) -> None:
    result = _asked(folder)
    scale = result.figures["scale"]
    assert abs(scale.value - 0.02) < 4 * scale.sigma
    assert scale.sigma < 0.003
    assert result.check("scale").status == "warn"
    assert "Depth against boards" in result.summary()


def test_a_tolerance_is_kept_or_missed(folder: Path) -> None:
    assert _asked(folder, tolerance="5%").check("tolerance").status == "ok"
    with pytest.raises(RefusedError, match="missed"):
        _asked(folder, tolerance="1%")


def test_input_that_does_not_belong_is_named(folder: Path) -> None:
    with pytest.raises(InputError, match="3 photos and 2 depth"):
        _asked(folder, depth=[folder / "d0.npy", folder / "d1.npy"])
    with pytest.raises(InputError, match="nothing to compare"):
        _asked(folder, depth=[])
    with pytest.raises(InputError, match="which camera"):
        _asked(folder, camera=None)
    with pytest.raises(InputError, match="per cent"):
        _asked(folder, tolerance="0.01")
