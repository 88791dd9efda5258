"""Kinematic identification on simulated arms with known truth, and on a real positioner."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from calibrant.calibrate.kinematics.compensation import compensate_joints
from calibrant.calibrate.kinematics.identify import calibrate_kinematics, identified_robot
from calibrant.calibrate.kinematics.model import Gravity, RobotModel, joint_terms
from calibrant.calibrate.kinematics.result import as_result, joint_axes
from calibrant.data.joint_measurements import JointMeasurements
from calibrant.errors import InputError, RefusedError
from calibrant.formats.robots.read import read_robot
from calibrant.geometry import se3, so3
from calibrant.robots.arms import arm
from calibrant.robots.links import as_links
from calibrant.simulate.robot_errors import SimulatedArm, measure, simulate_arm
from calibrant.simulate.truth import chi_square


def worn(seed: int, *, links: bool = False) -> tuple[SimulatedArm, np.random.Generator]:
    rng = np.random.default_rng(seed)
    nominal = as_links(arm("ur5e")) if links else arm("ur5e")
    return simulate_arm(nominal, rng, sigma_mm=0.5, sigma_deg=0.1), rng  # type: ignore[arg-type]


def new_errors_mm(model: RobotModel, simulated: SimulatedArm, rng: np.random.Generator) -> np.ndarray:
    q = simulated.draw_joints(rng, 200)
    return 1e3 * np.linalg.norm(model.predict(q)[:, :3, 3] - simulated.tool(q)[:, :3, 3], axis=1)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("mixed", ["two arms", "two places of the tracker"])
def test_rows_that_do_not_describe_one_arm_are_refused(mixed: str) -> None:
    simulated, rng = worn(3)
    q = simulated.draw_joints(rng, 60)
    one = measure(simulated, q, rng, sigma_mm=0.05, sigma_deg=0.01)
    positions = one.positions.copy()
    if mixed == "two arms":
        positions[30:] = measure(worn(4)[0], q[30:][:, ::-1], rng, sigma_mm=0.05, sigma_deg=0.01).positions
    else:
        positions[30:] = positions[30:] @ so3.exp([0.0, 0.0, 0.4]).T + [0.3, -0.2, 0.1]
    result = as_result(calibrate_kinematics(replace(one, positions=positions, rotations=None), simulated.nominal))
    fit = next(c for c in result.checks if c.name == "fit")
    assert fit.status == "fail"
    assert "do not describe one arm" in fit.message


def test_the_derivative_is_the_difference() -> None:
    rng = np.random.default_rng(0)
    chain = as_links(arm("ur5e"))
    gravity = Gravity(chain, (), payload=5.0)
    groups = ("offsets", "gear", "coupling", "elasticity")
    terms = joint_terms(6, groups)
    model = RobotModel(
        chain,
        se3.exp(rng.normal(size=6)),
        se3.exp(rng.normal(size=6)),
        terms,
        rng.normal(scale=1e-3, size=len(terms)),
        gravity,
    )
    q = rng.uniform(-2, 2, (3, 6))
    T, J = model.linearize(q)
    assert np.allclose(T, model.predict(q), atol=1e-14)
    for k in range(len(model.parameters)):
        step = 1e-6 * np.eye(len(model.parameters))[k]
        up, down = (se3.local(T, model.moved(s).predict(q)) for s in (step, -step))
        scale = max(1.0, np.abs(J[:, :, k]).max())  # torques make the columns of compliances some hundred times larger
        assert np.allclose(J[:, :, k], (up - down) / 2e-6, atol=5e-9 * scale), model.parameters[k]


def test_the_torque_of_a_weight_on_a_beam() -> None:
    # 2 kg, 0.5 m from a horizontal axis: m g l = 9.80665 N m, falling with the cosine.
    from calibrant.robots.chain import Joint
    from calibrant.robots.links import LinkChain, Load, Mover

    chain = LinkChain((Joint("a"),), (Mover("a", (0, 1, 0)),), np.array([np.eye(4)] * 2))
    gravity = Gravity(chain, (Load(0, 2.0, (0.5, 0, 0)),))
    # Turning about +y lowers the weight: gravity helps.
    assert np.allclose(gravity.torques([[0.0], [np.pi / 3]])[:, 0], [9.80665, 9.80665 / 2])


@pytest.mark.parametrize("sigma_deg", [None, 0.005], ids=["positions", "poses"])
@pytest.mark.parametrize("links", [False, True], ids=["dh", "links"])
def test_forty_poses_calibrate_an_arm(sigma_deg: float | None, links: bool) -> None:
    simulated, rng = worn(1, links=links)
    measurements = measure(simulated, simulated.draw_joints(rng, 40), rng, sigma_mm=0.05, sigma_deg=sigma_deg)
    calibration = calibrate_kinematics(measurements, simulated.nominal)
    assert rms(new_errors_mm(calibration.nominal, simulated, rng)) > 1.0
    assert rms(new_errors_mm(calibration.model, simulated, rng)) < 0.08
    # Six turning joints: four an axis and six of the tool; points show no rotation of the tool (Everett 1988).
    assert len(calibration.fitted) == (27 if sigma_deg is None else 30)
    assert calibration.noise["position"].sigma == pytest.approx(0.05e-3, rel=0.2)  # 4 standard deviations, r = 93
    assert as_result(calibration).verdict == "ok"


SCARA = """convention: standard
units: {length: mm, angle: deg}
joints:
  - {name: j1, a: 325, alpha: 0, d: 400, lower: -130, upper: 130}
  - {name: j2, a: 275, alpha: 180, d: 0, lower: -140, upper: 140}
  - {name: j3, kind: prismatic, a: 0, alpha: 0, d: 0, lower: 0, upper: 200}
  - {name: j4, a: 0, alpha: 0, d: 50, lower: -360, upper: 360}
"""


@pytest.mark.parametrize("sigma_deg", [None, 0.005])
def test_a_scara_whose_axes_are_all_parallel(sigma_deg: float | None, tmp_path: Path) -> None:
    file = tmp_path / "scara.yaml"
    file.write_text(SCARA)
    rng = np.random.default_rng(4)
    simulated = simulate_arm(read_robot(file).chain, rng, sigma_mm=0.5, sigma_deg=0.1)
    data = measure(simulated, simulated.draw_joints(rng, 40), rng, sigma_mm=0.05, sigma_deg=sigma_deg)
    calibration = calibrate_kinematics(data, simulated.nominal)
    # Twice what 40 poses of such an arm leave in the median, 0.03 mm.
    assert rms(new_errors_mm(calibration.model, simulated, rng)) < 0.06


def test_without_noise_the_truth_is_found_exactly() -> None:
    simulated, rng = worn(2)
    q = simulated.draw_joints(rng, 40)
    calibration = calibrate_kinematics(measure(simulated, q, rng, sigma_mm=0.0, sigma_deg=0.0), simulated.nominal)
    # 1e-3 of an effect is taken for redundancy; what remains of it is of second order, microns.
    assert new_errors_mm(calibration.model, simulated, rng).max() < 2e-2


@pytest.mark.statistics
def test_the_sigmas_tell_the_truth() -> None:
    squares, degrees = 0.0, 0
    for seed in range(6):
        simulated, rng = worn(seed)
        measurements = measure(simulated, simulated.draw_joints(rng, 40), rng, sigma_mm=0.05, sigma_deg=0.01)
        calibration = calibrate_kinematics(measurements, simulated.nominal)
        fitted = np.array([p.sigma is not None for p in calibration.parameters])
        everywhere = calibration.covariance[np.ix_(*[np.flatnonzero(np.diag(calibration.covariance) > 0)] * 2)]
        assert fitted.sum() == len(everywhere)
        q = simulated.draw_joints(rng, 1)
        T, J = calibration.model.linearize(q)
        e = se3.local(T, simulated.tool(q))[0]
        squares += chi_square(e, J[0] @ calibration.covariance @ J[0].T)
        degrees += 6
    assert 0.4 * degrees < squares < 2.0 * degrees  # chi-square with 36 degrees: 0.4 and 2.0 are beyond 99.9 %


def test_gears_couplings_and_soft_joints_are_found() -> None:
    simulated, rng = worn(3, links=True)
    terms = joint_terms(6, ("gear", "coupling", "elasticity"))
    gravity = Gravity(simulated.nominal, (), payload=10.0)
    theta = np.zeros(len(terms))
    theta[2], theta[-5] = 1e-3, 2e-5  # the elbow's gear; the shoulder lift's compliance
    truth = RobotModel(simulated.true, simulated.T_world_base, simulated.T_flange_tool, terms, theta, gravity)
    q = simulated.draw_joints(rng, 80)
    T = truth.predict(q)
    positions = T[:, :3, 3] + rng.normal(scale=5e-5, size=(80, 3))
    measurements = JointMeasurements(
        tuple(map(str, range(80))), q, positions, T[:, :3, :3] @ so3.exp(rng.normal(scale=1e-4, size=(80, 3)))
    )
    plain = calibrate_kinematics(measurements, simulated.nominal)
    full = calibrate_kinematics(
        measurements, simulated.nominal, identify=("offsets", "geometry", "gear", "elasticity"), gravity=gravity
    )
    found = {p.parameter.name: p for p in full.fitted}
    gear, soft = found["elbow gear error"], found["shoulder_lift compliance"]
    assert abs(gear.correction - 1e-3) < 4 * (gear.sigma or 0)
    assert abs(soft.correction - 2e-5) < 4 * (soft.sigma or 0)
    assert full.after.rms_mm < 0.5 * plain.after.rms_mm


def test_a_wrong_measurement_is_set_aside() -> None:
    simulated, rng = worn(4)
    measurements = measure(simulated, simulated.draw_joints(rng, 50), rng, sigma_mm=0.05, sigma_deg=0.01)
    positions = np.array(measurements.positions)
    positions[7] += [0.002, 0, 0]
    calibration = calibrate_kinematics(replace(measurements, positions=positions), simulated.nominal)
    assert np.flatnonzero(~calibration.used).tolist() == [7]
    result = as_result(calibration)
    assert result.verdict == "warn"
    assert not result.views[7].used


def test_compensated_joints_bring_the_arm_where_it_was_wanted() -> None:
    simulated, rng = worn(5)
    measurements = measure(simulated, simulated.draw_joints(rng, 60), rng, sigma_mm=0.02, sigma_deg=0.003)
    calibration = calibrate_kinematics(measurements, simulated.nominal)
    q = 0.5 * simulated.draw_joints(rng, 20)
    wanted = calibration.model.T_world_base @ simulated.nominal.forward(q) @ calibration.model.T_flange_tool
    compensation = compensate_joints(calibration.model, calibration.nominal, q)
    off = [
        1e3 * np.linalg.norm(simulated.tool(j)[:, :3, 3] - wanted[:, :3, 3], axis=1) for j in (q, compensation.joints)
    ]
    assert rms(off[0]) > 1.0
    assert rms(off[1]) < 0.05
    assert np.allclose(compensation.off_mm, off[0], atol=0.1)  # the model's own error, and the tool's


def test_the_corrected_robot_carries_the_offsets() -> None:
    simulated, rng = worn(6)
    measurements = measure(simulated, simulated.draw_joints(rng, 40), rng, sigma_mm=0.05, sigma_deg=0.01)
    calibration = calibrate_kinematics(measurements, simulated.nominal)
    q = simulated.draw_joints(rng, 5)
    T = calibration.model.T_world_base @ identified_robot(calibration).forward(q) @ calibration.model.T_flange_tool
    assert np.allclose(T, calibration.model.predict(q), atol=1e-12)


def positioner(folder: Path) -> JointMeasurements:
    data = yaml.safe_load((folder / "positioner_kinematic_measurements.yaml").read_text())
    poses = [entry["pose"] for entry in data.values()]
    return JointMeasurements(
        tuple(data),
        np.array([entry["target_joints"] for entry in data.values()]),
        np.array([[p[c] for c in "xyz"] for p in poses]),
        so3.from_quaternion_wxyz([[p[f"q{c}"] for c in "wxyz"] for p in poses]),
    )


@pytest.mark.parametrize("sign", [1, -1])
def test_coupled_joints_are_said_to_be(sign: int) -> None:
    """One joint at a time, the third told against the ground: it reads what the second does as well."""
    simulated, rng = worn(7)
    q = np.tile(simulated.draw_joints(rng, 1), (13, 1))
    for k in range(6):
        q[1 + 2 * k : 3 + 2 * k, k] += [0.3, 0.7]
    measured = measure(simulated, q, rng, sigma_mm=0.01, sigma_deg=0.002)
    told = q.copy()
    told[:, 2] += sign * q[:, 1]
    with pytest.raises(RefusedError, match=r"never moves alone: joint 3 reads as much .* The two are coupled"):
        calibrate_kinematics(replace(measured, joints=told))
    calibrate_kinematics(replace(measured, joints=q))


def test_a_real_positioner_without_any_model(shared_data: Callable[[str], Path]) -> None:
    calibration = calibrate_kinematics(positioner(shared_data("kinematic_rct_positioner")))
    assert calibration.after.rms_mm <= 0.41
    assert calibration.after.rms_deg is not None
    assert calibration.after.rms_deg <= 0.055
    assert len(calibration.fitted) == 14
    (found,) = joint_axes(calibration)
    assert len(found.axes) == 2
    for axis in found.axes:
        assert axis.sigma_direction_deg is not None
        # Neighbouring measurements err alike there (lag-1 correlation 0.6 to 0.8): alone they would have 0.005 deg.
        assert axis.sigma_direction_deg < 0.03
        assert axis.sigma_point_mm is not None
        assert axis.sigma_point_mm < 0.4
    # The maker's drawing of a positioner: two axes that cross at a right angle; within what the axes' sigmas allow.
    first, second = calibration.model.chain.directions  # type: ignore[attr-defined]
    assert abs(np.rad2deg(np.arccos(first @ second)) - 90) < 0.1
    assert as_result(calibration).verdict == "ok"


def test_a_sliding_axis_without_any_model() -> None:
    from calibrant.robots.chain import Joint
    from calibrant.robots.poe import ProductOfExponentials

    rng = np.random.default_rng(0)
    joints = (Joint("rail", 0, 1, "prismatic"), Joint("table"))
    truth = ProductOfExponentials(
        joints, np.array([[1, 0.1, 0], [0, 0, 1]]), np.array([[0, 0, 0], [0.3, 0.1, 0]]), se3.exp(rng.normal(size=6))
    )
    q = np.array([[r, t] for r in np.linspace(0, 1, 4) for t in np.linspace(-2, 2, 5)])
    T = truth.forward(q)
    measurements = JointMeasurements(tuple(map(str, range(20))), q, T[:, :3, 3], T[:, :3, :3])
    calibration = calibrate_kinematics(measurements)
    assert [j.kind for j in calibration.model.chain.joints] == ["prismatic", "revolute"]
    assert np.abs(calibration.model.predict(q) - T).max() < 1e-8


def test_what_cannot_be_calibrated_is_refused(shared_data: Callable[[str], Path]) -> None:
    simulated, rng = worn(7)
    q = simulated.draw_joints(rng, 40)
    measurements = measure(simulated, q, rng, sigma_mm=0.05, sigma_deg=None)
    with pytest.raises(RefusedError, match=r"8 measurements give 24 numbers for \d+ unknowns; take at least"):
        calibrate_kinematics(measurements.take(range(8)), simulated.nominal)
    with pytest.raises(InputError, match="this arm has 6 joints"):
        calibrate_kinematics(replace(measurements, joints=q[:, :5]), simulated.nominal)
    with pytest.raises(InputError, match=r"3: joint shoulder_lift is at \S+ deg, beyond its limits -360 to 360"):
        calibrate_kinematics(
            replace(measurements, joints=q + 10 * (np.arange(40)[:, None] == 3) * np.eye(6)[1]), simulated.nominal
        )
    with pytest.raises(RefusedError, match="positions alone do not start a robot without a nominal model"):
        calibrate_kinematics(measurements)
    with pytest.raises(RefusedError, match="never moves alone"):
        calibrate_kinematics(measure(simulated, q, rng, sigma_mm=0.05, sigma_deg=0.01))
    with pytest.raises(InputError, match="needs the robot's masses"):
        calibrate_kinematics(measurements, simulated.nominal, identify=("elasticity",))
    with pytest.raises(InputError, match="cannot identify 'wear'"):
        calibrate_kinematics(measurements, simulated.nominal, identify=("wear",))
    real = positioner(shared_data("kinematic_rct_positioner"))
    with pytest.raises(RefusedError, match="given in degrees, say so: --joint-angle deg"):
        calibrate_kinematics(replace(real, joints=np.rad2deg(real.joints)))


def test_a_joint_that_stands_still_is_named() -> None:
    simulated, rng = worn(8)
    q = simulated.draw_joints(rng, 40)
    q[:, 3] = 0.4
    calibration = calibrate_kinematics(measure(simulated, q, rng, sigma_mm=0.05, sigma_deg=0.01), simulated.nominal)
    check = as_result(calibration).check("excitation")
    assert check.status == "warn"
    assert "these poses do not show it" in check.message
