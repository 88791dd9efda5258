"""Results compared: which go together, transforms in mm and deg with sigma, what is warned of and what refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tests.made_results import camera

from calibrant.data import CalibrationResult, as_transform
from calibrant.data.details import Comparison
from calibrant.data.results import JointCovariance
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


def test_rigs_with_other_worlds_are_compared_by_their_chains() -> None:
    """Two calibrations of one rig, placed on other cameras: the same numbers, whichever transforms they are in."""
    left, right = (se3.make(so3.exp(r), t) for r, t in (([0.1, 0.5, 0], [0.2, 0, 0]), ([0, -0.4, 0.2], [0, 0.3, 0.1])))
    moved = se3.make(right[:3, :3], right[:3, 3] + [0.0, 0.004, 0.0])
    C = np.diag([1e-8] * 3 + [1e-6] * 3)
    first = CalibrationResult(
        "rig", "ok", transforms=(as_transform("a", "b", left, C), as_transform("a", "c", right, C))
    )
    between = as_transform("b", "c", se3.inverse(left) @ moved, C)
    second = CalibrationResult("rig", "ok", transforms=(as_transform("b", "a", se3.inverse(left), C), between))
    found = {(t.parent, t.child): t for t in compared(first, second).transforms}
    assert list(found) == [("a", "b"), ("a", "c"), ("b", "c")]
    assert np.allclose(found["a", "b"].mm, 0, atol=1e-9)
    assert np.allclose(found["a", "c"].mm, [0, 4, 0], atol=1e-9)
    assert (found["a", "b"].via, found["a", "c"].via, found["b", "c"].via) == ((), ("b",), ("a",))
    # Along the chain nothing says what the errors have in common, so nothing judges.
    assert found["a", "c"].chance is None
    assert compared(first, second).only_second == ()
    assert any("by way of b" in check.message for check in compare_results(first, second).checks)


def test_along_a_chain_the_sigma_is_that_of_the_joint_covariance() -> None:
    """Errors that both transforms share cancel between b and c."""
    T = [se3.make(np.eye(3), t) for t in ([0.2, 0, 0], [0.5, 0.1, 0])]
    shared, own = np.diag([0.0] * 3 + [1e-4] * 3), np.diag([1e-10] * 3 + [1e-6] * 3)
    joint = JointCovariance((("a", "b"), ("a", "c")), np.block([[shared + own, shared], [shared, shared + own]]))
    first = CalibrationResult(
        "rig",
        "ok",
        transforms=(as_transform("a", "b", T[0], shared + own), as_transform("a", "c", T[1], shared + own)),
        joint_covariance=joint,
    )
    second = CalibrationResult("rig", "ok", transforms=(as_transform("b", "c", se3.inverse(T[0]) @ T[1], own),))
    (found,) = compared(first, second).transforms
    assert found.mm_sigma == pytest.approx([1e3 * np.sqrt(3e-6)] * 3, rel=1e-2)
    assert found.chance == pytest.approx(1.0)


def test_frames_that_one_does_not_tie_are_said_to_be_its_own() -> None:
    both = placed(np.eye(4))
    more = replace(both, transforms=(*both.transforms, as_transform("gripper", "target", np.eye(4))))
    found = compared(more, both)
    assert ([(t.parent, t.child) for t in found.transforms], found.only_first) == (
        [("base", "camera")],
        ("gripper → target",),
    )
