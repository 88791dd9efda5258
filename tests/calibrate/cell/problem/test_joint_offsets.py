"""Joint offsets found in the image problem, within their sigma, and a camera that is the better for it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from calibrant.calibrate.cell.calibrate import calibrate_cell
from calibrant.calibrate.cell.problem.joint_offsets import JointReadings, JointRotation, JointTranslation, free_joints
from calibrant.calibrate.cell.problem.layout import Pictures
from calibrant.data import CalibrationResult, Observations
from calibrant.data.details import RobotParameters
from calibrant.data.typed_json import as_json
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.robots.arms import arm
from calibrant.robots.geometry import ParametricChain
from calibrant.robots.inverse import solve_inverse
from calibrant.simulate.scenes import grid, gripper_poses, look_at_board, observe, standard_camera, standard_mounting

CAMERA, POINTS = standard_camera(), grid(9, 7, 0.02)
X, Z = standard_mounting("eye-in-hand")
OFFSETS_DEG = np.array([0.0, 0.25, -0.3, 0.2, -0.25, 0.0])
"""Of the four joints that pictures can tell; the first and last act as the target's and the camera's place."""
REPEATABILITY = np.deg2rad(0.003)


@dataclass(frozen=True)
class Scene:
    """An arm whose joints are off by OFFSETS_DEG, and what its camera saw."""

    readings: JointReadings
    observations: Observations


def ur5e() -> ParametricChain:
    chain = arm("ur5e")
    assert isinstance(chain, ParametricChain)
    return chain


def scene(seed: int, views: int = 25) -> Scene:
    rng = np.random.default_rng(seed)
    chain, q = ur5e(), np.zeros((0, 6))
    while len(q) < views:
        B = look_at_board(CAMERA, POINTS, 40, rng=rng, distance=(0.35, 0.65), tilt_deg=40)
        start = np.array([0.2, -1.6, 1.8, -1.8, -1.57, 0.3]) + rng.uniform(-0.4, 0.4, (40, 6))
        found = solve_inverse(chain, gripper_poses("eye-in-hand", X, Z, B), start)
        q = np.concatenate([q, found.q[found.reached]])[:views]
    T = chain.forward(q)
    seen = observe(CAMERA, POINTS, se3.inverse(X) @ se3.inverse(T) @ Z, sigma_px=0.1, rng=rng)
    read = q - np.deg2rad(OFFSETS_DEG) + rng.normal(scale=REPEATABILITY, size=q.shape)
    return Scene(JointReadings.from_values(read, chain), seen)


def calibrated(s: Scene, *, free: bool) -> CalibrationResult:
    pictures = [Pictures("camera", "eye-in-hand", s.observations)]
    joints = s.readings if free else None
    return calibrate_cell(s.readings.poses, pictures, cameras={"camera": CAMERA}, joints=joints)


def found_offsets(result: CalibrationResult) -> dict[str, dict[str, float]]:
    return {p.name: as_json(p) for p in result.detail(RobotParameters).robots["robot"]}


def camera_error_mm(result: CalibrationResult) -> float:
    return 1e3 * float(np.linalg.norm(result.transform("gripper", "camera").matrix[:3, 3] - X[:3, 3]))


@pytest.mark.statistics
def test_offsets_are_recovered_within_sigma_and_the_camera_gets_better() -> None:
    normalised, with_offsets, without = [], [], []
    for seed in range(4):
        s = scene(seed)
        result = calibrated(s, free=True)
        rows = found_offsets(result)
        for name, truth in zip((j.name for j in s.readings.chain.joints), OFFSETS_DEG):
            row = rows[f"{name} offset"]
            if "sigma" in row:
                normalised.append((row["correction"] - np.deg2rad(truth)) / row["sigma"])
        with_offsets.append(camera_error_mm(result))
        without.append(camera_error_mm(calibrated(s, free=False)))
    # Four offsets in each of four scenes; the errors of one scene are correlated, so the bounds are wide.
    assert len(normalised) == 16
    assert 0.5 < np.sqrt(np.mean(np.square(normalised))) < 1.6
    assert np.median(with_offsets) < 0.6 * np.median(without)


@pytest.mark.long
def test_offsets_that_act_as_camera_or_target_are_held_and_said() -> None:
    rows = found_offsets(calibrated(scene(0), free=True))
    assert "redundant" in rows["shoulder_pan offset"]["reason"]
    assert "redundant" in rows["wrist_3 offset"]["reason"]


def test_the_poses_of_the_result_have_the_offsets_applied() -> None:
    s = scene(1)
    result = calibrated(s, free=True)
    assert result.robot_poses is not None
    error = se3.local(s.readings.poses.T_base_gripper, result.robot_poses.T_base_gripper)
    assert 1e3 * np.linalg.norm(error[:, 3:], axis=1).mean() > 1.0
    assert result.check("joints").status == "ok"
    assert result.sigma_robot is not None
    # What is left is the repeatability, 0.003 deg on a lever of up to a metre, not the offsets' millimetres.
    assert result.sigma_robot.mm < 0.1


def test_jacobians_are_the_derivatives() -> None:
    s = scene(2, views=5)
    free = free_joints(s.readings, ("offsets", "gear", "geometry"))
    rng = np.random.default_rng(0)
    model = free.model.moved(1e-2 * rng.normal(size=len(free.model.parameters)))
    T = se3.retract(model.predict(s.readings.q), 1e-2 * rng.normal(size=(5, 6)))
    state, errors = np.broadcast_to(model.state, (5, len(model.state))), 1e-2 * rng.normal(size=(5, 6))
    for kind in (JointRotation, JointTranslation):
        factor = kind(free.model, ("poses", "geometry", "errors"), s.readings.q, "noise")
        _, (of_pose, of_model, of_errors) = factor.linearize(T, state, errors)
        h = 1e-6
        for k in range(6):
            d = np.eye(6)[k] * h
            ahead, behind = (factor.residuals(se3.retract(T, s * d), state, errors) for s in (1, -1))
            np.testing.assert_allclose(of_pose[:, :, k], (ahead - behind) / (2 * h), atol=1e-8)
            ahead, behind = (factor.residuals(T, state, errors + s * d) for s in (1, -1))
            np.testing.assert_allclose(of_errors[:, :, k], (ahead - behind) / (2 * h), atol=1e-8)
        for k in range(len(model.parameters)):
            d = np.eye(len(model.parameters))[k] * h
            ahead, behind = (
                factor.residuals(T, np.broadcast_to(model.moved(s * d).state, state.shape), errors) for s in (1, -1)
            )
            np.testing.assert_allclose(of_model[:, :, k], (ahead - behind) / (2 * h), atol=1e-8)


def test_readings_beyond_the_limits_or_of_another_name_are_refused() -> None:
    with pytest.raises(InputError, match="beyond its limits"):
        JointReadings.from_values(np.full((3, 6), 7.0), ur5e())
    readings = JointReadings.from_values(np.zeros((3, 6)), ur5e())
    with pytest.raises(InputError, match="no joint values for 'x'"):
        readings.only(["x"])
    with pytest.raises(InputError, match="cannot identify 'springs'"):
        free_joints(readings, ("springs",))
    with pytest.raises(InputError, match="one row a name"):
        replace(readings, ids=("only one",))
