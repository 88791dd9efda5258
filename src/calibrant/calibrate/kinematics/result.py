"""A kinematic calibration as a `CalibrationResult`: transforms, noise, checks, and the parameters as a table."""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.kinematics.coupled_joints import coupled_joints
from calibrant.calibrate.kinematics.identify import KinematicCalibration, figure
from calibrant.calibrate.kinematics.problem import POSITION, ROTATION, ModelErrors
from calibrant.data import (
    CalibrationResult,
    Check,
    HeldOut,
    Measured,
    SigmaRobot,
    TransformEstimate,
    ViewResult,
    verdict_of,
)
from calibrant.data.details import JointAxes, JointAxis, RobotParameter, RobotParameters, Triple
from calibrant.optimize.noise import NoiseLevel
from calibrant.robots.poe import ProductOfExponentials

DOUBTED, DISAGREES = 0.02, 0.05
"""Share of the motion that an identified arm may leave: one that nobody identified leaves a hundredth (millimetres of
some hundred), rows of two arms or of two places of the tracker tens of per cent."""
SHARED_SAID = 1.3
"""How much wider sigma is for shared errors before it is said: by chance a fit of sixty has 1.2."""
HELD_OUT_FACTOR = 1.5
"""Held-out errors this many times those of the fit mean that the fit follows the noise: with twice as many numbers as
unknowns the expected ratio is sqrt((1 + 1/2) / (1 - 1/2)) = 1.7, with five times as many 1.2."""


def as_result(calibration: KinematicCalibration) -> CalibrationResult:
    """The calibration in the form of every result; parameters and axes are among its `details`."""
    checks = _kinematic_checks(calibration)
    held = calibration.held_out
    return CalibrationResult(
        kind="kinematics",
        verdict=verdict_of(checks),
        checks=checks,
        transforms=_kinematic_transforms(calibration),
        sigma_robot=_kinematic_noise(calibration),
        views=_kinematic_views(calibration),
        held_out=None if held is None else HeldOut(mm=held.rms_mm, deg=held.rms_deg),
        figures={**_errors("rms_before", calibration.before), **_errors("rms_after", calibration.after)},
        details=(robot_parameters(calibration), *joint_axes(calibration)),
    )


def robot_parameters(calibration: KinematicCalibration) -> RobotParameters:
    """Every candidate: name, group, unit, correction and sigma in the unit, or the reason why it is not fitted."""
    rows = (
        RobotParameter(p.parameter.name, p.parameter.unit, p.correction, p.sigma, p.reason or None, p.parameter.group)
        for p in calibration.parameters
    )
    return RobotParameters({"robot": tuple(rows)})


def joint_axes(calibration: KinematicCalibration) -> tuple[JointAxes, ...]:
    """Axes of a product of exponentials in the measuring frame: direction, a point, 1 sigma of tilt and shift.

    The sigmas are those of the worse of the two directions across the axis. Empty for a robot that had a nominal one.
    """
    chain = calibration.model.chain
    if not isinstance(chain, ProductOfExponentials):
        return ()
    sigma = {p.parameter.name: p.sigma for p in calibration.parameters}
    rows = []
    for k, joint in enumerate(chain.joints):
        tilt = [sigma[f"{joint.name} tilt {w}"] for w in "uv"]
        shift = [sigma.get(f"{joint.name} shift {w}") for w in "uv"]
        rows.append(
            JointAxis(
                joint.name,
                joint.kind,
                _triple(chain.directions[k]),
                _triple(chain.points[k]),
                _worst(tilt, 180 / np.pi),
                _worst(shift, 1e3),
            )
        )
    return (JointAxes(tuple(rows)),)


def _triple(v: Array) -> Triple:
    x, y, z = v.tolist()
    return x, y, z


def _worst(sigmas: list[float | None], factor: float) -> float | None:
    known = [s for s in sigmas if s is not None]
    return max(known) * factor if len(known) == len(sigmas) else None


def _errors(name: str, errors: ModelErrors) -> dict[str, Measured]:
    out = {f"{name}_mm": Measured(errors.rms_mm, unit="mm")}
    if errors.rms_deg is not None:
        out[f"{name}_deg"] = Measured(errors.rms_deg, unit="deg")
    return out


def _kinematic_transforms(calibration: KinematicCalibration) -> tuple[TransformEstimate, ...]:
    out: list[TransformEstimate] = []
    model, C = calibration.model, calibration.covariance
    if calibration.base_free:
        out.append(TransformEstimate("world", "base", model.T_world_base, C[:6, :6]))
    if calibration.tool_free:
        out.append(TransformEstimate("flange", "tool", model.T_flange_tool, C[-6:, -6:]))
    return tuple(out)


def _kinematic_noise(calibration: KinematicCalibration) -> SigmaRobot:
    position = calibration.noise[POSITION]
    rotation = calibration.noise.get(ROTATION, NoiseLevel(0.0, 0.0, 0.0))
    return SigmaRobot(
        1e3 * position.sigma,
        float(np.rad2deg(rotation.sigma)),
        1e3 * position.deviation,
        float(np.rad2deg(rotation.deviation)) or None,
    )


def _kinematic_views(calibration: KinematicCalibration) -> tuple[ViewResult, ...]:
    rows = zip(calibration.measurements.ids, calibration.used.tolist(), calibration.outlier_sizes.tolist())
    return tuple(ViewResult(i, used, 1, reason=None if used else _outlier(size)) for i, used, size in rows)


def _outlier(size: float) -> str:
    return f"{size:.1f} times the noise away from all others"


def _kinematic_checks(calibration: KinematicCalibration) -> tuple[Check, ...]:
    held = calibration.held_out
    fitted, held_back = len(calibration.fitted), len(calibration.parameters) - len(calibration.fitted)
    unshown = [p for p in calibration.parameters if p.reason and not p.reason.startswith("redundant")]
    checks = [
        Check("parameters", "ok", f"{fitted} parameters identified, {held_back} redundant or held", float(fitted)),
        _fit_check(calibration),
    ]
    if calibration.shared_times >= SHARED_SAID:
        text = (
            f"neighbouring measurements err alike: every sigma holds it, {calibration.shared_times:.1f} times their own"
        )
        checks.append(Check("shared-errors", "ok", text, calibration.shared_times))
    if unshown:
        names = ", ".join(p.parameter.name for p in unshown[:5]) + (" …" if len(unshown) > 5 else "")
        first = unshown[0]
        checks.append(Check("excitation", "warn", f"not determined: {names} ({first.parameter.name}: {first.reason})"))
    left_out = int((~calibration.used).sum())
    if left_out:
        ids = calibration.measurements.ids
        worst = int(np.argmax(np.where(calibration.used, 0, calibration.outlier_sizes)))
        text = f"{left_out} of {len(calibration.used)} measurements left out; worst: {ids[worst]}"
        checks.append(Check("outliers", "warn", text, float(left_out)))
    if held is None:
        text = "too few measurements to keep some out of the fit: the error between them is not known"
        checks.append(Check("held-out", "warn", text))
    else:
        checks.append(_held_out_check(calibration))
    return tuple(checks)


def _fit_check(calibration: KinematicCalibration) -> Check:
    """Do joints and measurements describe one arm, at one place?"""
    before, after, held = calibration.before, calibration.after, calibration.held_out
    text = f"errors {_words(before)} rms before, {_words(after)} after"
    p = 1e3 * calibration.measurements.positions[calibration.used]
    size = float(np.linalg.norm(p - p.mean(axis=0), axis=1).mean()) if len(p) else 0.0
    left = max(after.rms_mm, held.rms_mm if held is not None else 0.0)
    if size <= 0 or left <= DOUBTED * size:
        return Check("fit", "ok", text, after.rms_mm)
    text += f"; {left:.3g} mm are left of a motion of {size:.3g} mm: joints and measurements do not describe one arm. "
    coupled = None if calibration.free_model else coupled_joints(calibration.nominal, calibration.measurements)
    if coupled is not None:
        how = "added" if coupled.sign > 0 else "taken off"
        text += f"Joint {coupled.joint + 1} is told with joint {coupled.by + 1} {how}, as where J3 is told against the "
        text += f"ground (Fanuc): {coupled.error_mm:.3g} mm are left without that; give --identify "
        text += "offsets,geometry,coupling, or the joints as the links turn"
    else:
        text += "Are they of one robot and one place of the measuring device, in the right units and the right rows?"
    return Check("fit", "fail" if left > DISAGREES * size else "warn", text, after.rms_mm)


def _held_out_check(calibration: KinematicCalibration) -> Check:
    held, after, before = calibration.held_out, calibration.after, calibration.before
    if held is None:
        raise ValueError("asked for a check of a hold-out that was not made")
    words = _words(held)
    # The nominal robot with its best base is the bar: what does not beat it on new poses is no calibration.
    if held.rms_mm > before.rms_mm and not calibration.free_model:
        text = f"on measurements kept out the error is {words} rms, more than the nominal robot's; take more poses"
        return Check("held-out", "fail", text, held.rms_mm)
    if held.rms_mm > HELD_OUT_FACTOR * after.rms_mm:
        times = held.rms_mm / after.rms_mm
        text = f"{words} rms on measurements kept out, {times:.1f} times the fit's error; take more poses"
        return Check("held-out", "warn", text, held.rms_mm)
    return Check("held-out", "ok", f"{words} rms on measurements kept out of the fit (five parts in turn)", held.rms_mm)


def _words(errors: ModelErrors) -> str:
    """The rms errors with their units."""
    turn = "" if errors.rms_deg is None else f", {figure(np.deg2rad(errors.rms_deg), 'rad')}"
    return figure(1e-3 * errors.rms_mm, "m") + turn
