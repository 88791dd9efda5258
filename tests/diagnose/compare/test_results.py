"""Results compared: which go together, transforms in mm and deg with sigma, what is warned of and what refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tests.made_results import camera

from calibrant.data import CalibrationResult, as_transform
from calibrant.data.details import Comparison
from calibrant.diagnose.compare.results import compare_results
from calibrant.errors import InputError
from calibrant.geometry import se3, so3


def compared(first: CalibrationResult, second: CalibrationResult, **more: object) -> Comparison:
    found = compare_results(first, second, **more).detail(Comparison)  # type: ignore[arg-type]
    assert found is not None
    return found


def placed(T: np.ndarray, sigma: float | None = 1e-3) -> CalibrationResult:
    C = None if sigma is None else np.eye(6) * sigma**2
    return CalibrationResult("rig", "ok", transforms=(as_transform("base", "camera", T, C),))


def test_a_transform_moved_by_hand_either_way_round() -> None:
    T = se3.make(so3.exp([0.3, -0.2, 0.5]), [0.1, 0.2, 0.3])
    turn = np.deg2rad([0.1, 0.0, -0.2])
    moved = se3.make(so3.exp(turn) @ T[:3, :3], T[:3, 3] + [1e-3, 0.0, -2e-3])
    back = CalibrationResult(
        "rig", "ok", transforms=(as_transform("camera", "base", se3.inverse(moved), np.eye(6) * 1e-6),)
    )
    for second in (placed(moved), back):
        (found,) = compared(placed(T), second).transforms
        assert np.allclose(found.mm, [1, 0, -2], atol=1e-9)
        assert np.allclose(found.deg, [0.1, 0, -0.2], atol=1e-9)
    (found,) = compared(placed(T), placed(moved)).transforms
    assert found.mm_sigma == pytest.approx([np.sqrt(2)] * 3)
    assert found.deg_sigma == pytest.approx([np.rad2deg(np.sqrt(2) * 1e-3)] * 3)


def test_what_the_sigmas_do_not_explain_is_warned_of() -> None:
    T = np.eye(4)
    far = se3.make(np.eye(3), [0.02, 0, 0])
    assert compare_results(placed(T), placed(far)).verdict == "warn"
    assert compare_results(placed(T), placed(se3.make(np.eye(3), [0.002, 0, 0]))).verdict == "ok"
    unknown = compare_results(placed(T, None), placed(far))
    assert unknown.verdict == "ok"
    assert "no uncertainty" in unknown.checks[0].message


def test_a_result_is_like_itself(hand_eye_result: Callable[[str], CalibrationResult]) -> None:
    given = hand_eye_result("eye-to-hand")
    found = compare_results(given, given)
    assert found.verdict == "ok"
    assert len(compared(given, given).transforms) == len(given.transforms)
    assert found.figures["difference"].value == pytest.approx(0.0, abs=1e-9)


def test_cameras_go_by_name_or_as_they_are_told() -> None:
    one, other = camera(), replace(camera(), values=camera().values + np.eye(9)[0])
    first = CalibrationResult("rig", "ok", cameras={"left": one, "right": one})
    second = CalibrationResult("rig", "ok", cameras={"cam0": other, "cam1": one})
    with pytest.raises(InputError, match="--camera FIRST:SECOND"):
        compare_results(first, second)
    (found,) = compared(first, second, cameras=[("left", "cam0")]).cameras
    assert {p.name: p.difference for p in found.parameters}["fx"] == pytest.approx(1.0)
    with pytest.raises(InputError, match="no camera 'cam7'; its cameras: cam0, cam1"):
        compare_results(first, second, cameras=[("left", "cam7")])
    assert compared(first, replace(first, cameras={"left": other, "top": one})).only_second == ("top",)


def test_nothing_in_common_is_refused() -> None:
    with pytest.raises(InputError, match="no camera and no transform in common"):
        compare_results(placed(np.eye(4)), CalibrationResult("intrinsics", "ok", cameras={"camera": camera()}))


def test_sizes_and_models_are_said() -> None:
    small = camera()
    shape = CalibrationResult("x", "ok", cameras={"c": replace(small, image_size=(1280, 1000))})
    found = compare_results(CalibrationResult("x", "ok", cameras={"c": small}), shape)
    assert found.verdict == "warn"
    assert "pixel by pixel as they stand" in found.check("size-c").message
