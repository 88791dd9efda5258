"""Figures of a result: rotation angles, quaternions and their propagated uncertainty."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibrant.data import CalibrationResult, TransformEstimate, as_transform
from calibrant.geometry import se3, so3
from calibrant.reports.parts.figures import method_rows, noise_facts, quaternion_figures, yaw_pitch_roll_figures


def _estimate() -> TransformEstimate:
    A = np.random.default_rng(3).normal(size=(6, 6)) * 1e-3
    return as_transform("base", "camera", se3.make(so3.exp([0.7, -0.4, 1.9]), [0.1, 0.2, 0.3]), A @ A.T)


def test_angles_and_quaternion_agree_with_scipy() -> None:
    estimate = _estimate()
    rotation = Rotation.from_matrix(estimate.matrix[:3, :3])
    angles = [f.value for f in yaw_pitch_roll_figures(estimate)]
    np.testing.assert_allclose(angles, rotation.as_euler("ZYX", degrees=True), atol=1e-10)
    q = np.array([f.value for f in quaternion_figures(estimate)])
    np.testing.assert_allclose(q * np.sign(q[3]), rotation.as_quat(canonical=True), atol=1e-12)


def test_sigmas_agree_with_differences_of_the_chart() -> None:
    estimate = _estimate()

    def numbers(omega: np.ndarray) -> np.ndarray:
        moved = as_transform("base", "camera", se3.retract(estimate.matrix, [*omega, 0, 0, 0]))
        return np.array([f.value for f in (*yaw_pitch_roll_figures(moved), *quaternion_figures(moved))])

    step = 1e-6  # central differences: truncation ~1e-12, rounding ~1e-10 of angles in degrees
    J = np.stack([(numbers(step * e) - numbers(-step * e)) / (2 * step) for e in np.eye(3)], axis=-1)
    assert estimate.covariance is not None
    expected = np.sqrt(np.diag(J @ estimate.covariance[:3, :3] @ J.T))
    found = [f.sigma for f in (*yaw_pitch_roll_figures(estimate), *quaternion_figures(estimate))]
    np.testing.assert_allclose(np.array(found, dtype=float), expected, rtol=1e-6)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("off", [0.0, 2e-4])
def test_gimbal_lock_gives_angles_that_rebuild_the_rotation_and_roll_no_sigma(sign: int, off: float) -> None:
    """At 90 deg of pitch, and within the rotation's uncertainty of it, where yaw alone would be known to 80 deg."""
    R = so3.exp([off, 0, 0]) @ Rotation.from_euler("ZYX", [40, 90 * sign, 0], degrees=True).as_matrix()
    C = np.diag(np.array([3e-4, 2e-4, 1e-4, 0, 0, 0]) ** 2)
    figures = yaw_pitch_roll_figures(as_transform("a", "b", se3.make(R, np.zeros(3)), C))
    rebuilt = so3.exp([0, 0, np.deg2rad(figures[0].value)]) @ so3.exp([0, np.deg2rad(figures[1].value), 0])
    np.testing.assert_allclose(rebuilt, R, atol=off + 1e-9)
    yaw, pitch, roll = (f.sigma for f in figures)
    assert roll is None
    assert yaw == pytest.approx(np.rad2deg(1e-4))
    turned = np.hypot(3e-4 * np.sin(np.deg2rad(figures[0].value)), 2e-4 * np.cos(np.deg2rad(figures[0].value)))
    assert pitch == pytest.approx(np.rad2deg(turned))


def test_methods_are_measured_from_the_joint_refinement(hand_eye_result: Callable[[str], CalibrationResult]) -> None:
    rows = {row.name: row for row in method_rows(hand_eye_result("eye-to-hand"))}
    # The fixture moves Park's transform by (0.5, 0, 0.3) mm and 1 mrad.
    assert rows["park"].from_joint_mm == pytest.approx(np.hypot(0.5, 0.3))
    assert rows["park"].from_joint_deg == pytest.approx(np.rad2deg(1e-3))
    assert rows["tsai"].from_joint_mm is None
    assert rows["joint"].from_joint_mm is None


def test_facts_say_which_noise_is_meant(hand_eye_result: Callable[[str], CalibrationResult]) -> None:
    facts = {fact.name: fact for fact in noise_facts(hand_eye_result("eye-in-hand"))}
    assert facts["RMS error"].note == "per point, both axes"
    assert "per axis" in facts["pixel noise, 1σ"].note
    assert facts["robot noise, 1σ"].text == "0.104 ± 0.012 mm, 0.0211 ± 0.0021 deg"
    assert facts["target scale"].text == "1.0012 ± 0.0031"
    assert facts["held-out error"].text == "0.420 mm, 0.0410 deg, 0.630 px"
