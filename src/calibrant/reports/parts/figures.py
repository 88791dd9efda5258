"""The figures of a result, ready to be shown: parameters, transforms, noise, methods, each with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.cameras.model import REQUIRED
from calibrant.data import DEFAULT_CAMERA, CalibrationResult, MethodResult, SigmaRobot, TransformEstimate
from calibrant.geometry import se3, so3
from calibrant.reports.parts.numbers import Figure, plain, sigma_text, with_sigma

JOINT = "joint"
"""Name of the weighted joint refinement among the methods."""
MOST_LISTED = 24
"""Parameters in a list that is still read; the largest model of named terms has 18."""
_GIMBAL_COSINE = 1e-6
"""Below this cosine of the pitch, yaw and roll turn about the same axis and have no uncertainty of their own."""
_GIMBAL_UNSURE = 0.05
"""So they do where the pitch is 90 deg within one sigma of the rotation, if that is no more than this, radians: yaw
would be known to a radian at best."""


@dataclass(frozen=True)
class MethodRow:
    """One hand-eye method: the loop's spread and how far its camera transform lies from the joint refinement's."""

    name: str
    loop_mm: float | None
    loop_deg: float | None
    from_joint_mm: float | None
    from_joint_deg: float | None
    message: str


@dataclass(frozen=True)
class Fact:
    """A line of the summary: what it is, the figure in words with its unit, and what it means. value: what a figure
    that is an uncertainty belongs to, where lines are as long as they need to be."""

    name: str
    text: str
    note: str = ""
    value: str = ""


def camera_figures(camera: Camera) -> list[Figure]:
    """The camera's parameters in the model's order; fixed ones have sigma 0."""
    sigma = camera.sigma
    names, units = camera.model.parameter_names, camera.model.parameter_units
    return [Figure(n, camera.parameters[n], sigma.get(n), unit) for n, unit in zip(names, units, strict=True)]


def listed_figures(camera: Camera) -> tuple[list[Figure], str]:
    """The parameters that a person reads one by one, and a sentence on the others: a splined model has hundreds."""
    figures = camera_figures(camera)
    if len(figures) <= MOST_LISTED:
        return figures, ""
    shown, others = figures[: len(REQUIRED)], figures[len(REQUIRED) :]
    text = f"and {len(others)} more, {others[0].name} to {others[-1].name}, in the result file"
    sigma = np.array([f.sigma for f in others if f.sigma], dtype=np.float64)
    if len(sigma):
        text += (
            f"; their 1σ is {sigma_text(float(np.median(sigma)))} (median) to {sigma_text(float(sigma.max()))} (worst)"
        )
    return shown, text


def translation_figures(estimate: TransformEstimate) -> list[Figure]:
    """Position of the child's origin in the parent, millimetres."""
    sigma = estimate.sigma_translation_mm
    t = 1e3 * estimate.matrix[:3, 3]
    return [Figure(n, float(t[i]), None if sigma is None else float(sigma[i]), "mm") for i, n in enumerate("xyz")]


def matrix_text(matrix: Array) -> str:
    """The 4x4, metres, as Python and JSON read it, one row a line."""
    rows = (", ".join(f"{v + 0.0:.7f}" for v in np.round(row, 7)) for row in matrix)
    return "[" + ",\n ".join(f"[{row}]" for row in rows) + "]"


def is_point(estimate: TransformEstimate) -> bool:
    """Whether only the child's place is meant, as with a tool's tip: no turn, exactly, and none that is uncertain."""
    C = estimate.covariance
    turned = np.any(estimate.matrix[:3, :3] != np.eye(3))
    return bool(C is not None and not turned and not np.any(C[:3, :3]) and np.any(C[3:, 3:]))


def quaternion_figures(estimate: TransformEstimate) -> list[Figure]:
    """Quaternion x, y, z, w (w >= 0) with sigma from q' = (1, omega/2) q, omega about the parent's axes."""
    w, x, y, z = so3.quaternion_wxyz(estimate.matrix[:3, :3])
    # d(xyzw)/d(omega) of the product (0, omega/2) (w, v): dv = (w omega + omega x v)/2, dw = -omega.v/2.
    J = 0.5 * np.array([[w, z, -y], [-z, w, x], [y, -x, w], [-x, -y, -z]])
    sigma = _propagated(J, estimate)
    return [Figure(f"q{n}", float(q), s, "1") for n, q, s in zip("xyzw", (x, y, z, w), sigma, strict=True)]


def yaw_pitch_roll_figures(estimate: TransformEstimate) -> list[Figure]:
    """Yaw, pitch, roll in degrees, R = Rz(yaw) Ry(pitch) Rx(roll), with their sigma.

    omega = yaw' e_z + pitch' Rz e_y + roll' Rz Ry e_x gives the rates, hence the sigma; at pitch = ±90 deg yaw and roll
    cannot be told apart: roll is set to 0 and has no sigma. So it is where the pitch is 90 deg within the uncertainty,
    as of tags on the sides of a box.
    """
    R = estimate.matrix[:3, :3]
    cosine = float(np.hypot(R[0, 0], R[1, 0]))
    pitch = float(np.arctan2(-R[2, 0], cosine))
    unsure = 0.0 if estimate.covariance is None else float(np.sqrt(np.linalg.norm(estimate.covariance[:3, :3], 2)))
    if cosine < max(_GIMBAL_COSINE, min(unsure, _GIMBAL_UNSURE)):
        yaw, roll = float(np.arctan2(-R[0, 1], R[1, 1])), 0.0
        pitch = float(np.arctan2(-R[2, 0], R[0, 0] * np.cos(yaw) + R[1, 0] * np.sin(yaw)))  # beyond 90 deg, too
        axes = np.array([[0, 0, 1], [-np.sin(yaw), np.cos(yaw), 0]])
        sigma: list[float | None] = [*_propagated(np.rad2deg(axes), estimate), None]
    else:
        yaw, roll = float(np.arctan2(R[1, 0], R[0, 0])), float(np.arctan2(R[2, 1], R[2, 2]))
        cy, sy = np.cos(yaw), np.sin(yaw)
        axes = np.array([[0, -sy, cy * np.cos(pitch)], [0, cy, sy * np.cos(pitch)], [1, 0, -np.sin(pitch)]])
        sigma = _propagated(np.rad2deg(np.linalg.inv(axes)), estimate)
    names = ("yaw", "pitch", "roll")
    return [Figure(n, float(np.rad2deg(a)), s, "deg") for n, a, s in zip(names, (yaw, pitch, roll), sigma, strict=True)]


def method_rows(result: CalibrationResult) -> list[MethodRow]:
    """The methods in the result's order, each beside the joint refinement (or the result's own camera transform)."""
    cameras = [t.matrix for t in result.transforms if t.child in result.cameras or t.child == DEFAULT_CAMERA]
    rows = []
    for name, method in result.methods.items():
        # Of several cameras each has its own methods: "left: park".
        label = name.rpartition(": ")[0]
        own = f"{label}: {JOINT}" if label else JOINT
        joint = result.methods.get(own)
        reference = joint.matrix if joint is not None else cameras[0] if cameras else None
        rows.append(_method_row(name, method, None if name == own else reference))
    return rows


def noise_facts(
    result: CalibrationResult, *, robot: str = "robot noise, 1σ", rows: str = "views", kept_out: str = ""
) -> list[Fact]:
    """Residuals, estimated noise, target scale and held-out errors, as far as the result has them.

    robot: what the noise of the poses is called; rows: what was kept out, in the plural, or `kept_out` in whole words.
    """
    facts: list[Fact] = []
    if result.rms_px is not None:
        facts.append(Fact("RMS error", f"{plain(result.rms_px, digits=3)} px", "per point, both axes"))
    if result.sigma_px is not None:
        facts.append(Fact("pixel noise, 1σ", f"{plain(result.sigma_px, digits=3)} px", "per axis, from the residuals"))
    if result.sigma_robot is not None:
        facts.append(Fact(robot, _robot_noise_text(result.sigma_robot), "per axis, estimated from the data"))
    if result.target_scale is not None:
        scale = result.target_scale
        facts.append(Fact("target scale", with_sigma(scale.value, scale.sigma), "real size / given size"))
    held = result.held_out
    if held is not None:
        figures = ((held.mm, "mm"), (held.deg, "deg"), (held.px, "px"))
        parts = [f"{plain(value, digits=3)} {unit}" for value, unit in figures if value is not None]
        if parts:
            facts.append(Fact("held-out error", ", ".join(parts), kept_out or f"RMS on {rows} kept out of the fit"))
    return facts


def _robot_noise_text(noise: SigmaRobot) -> str:
    text = f"{with_sigma_or_plain(noise.mm, noise.mm_sigma)} mm"
    # Of positions alone, as a laser tracker gives them, no turn is known.
    if noise.deg or noise.deg_sigma:
        text += f", {with_sigma_or_plain(noise.deg, noise.deg_sigma)} deg"
    return text


def with_sigma_or_plain(value: float, sigma: float | None) -> str:
    """Value ± sigma, or three digits of the value when its uncertainty is not known."""
    return plain(value, digits=3) if not sigma else with_sigma(value, sigma)


def _propagated(J: Array, estimate: TransformEstimate) -> list[float | None]:
    """1 sigma of each row of J times the rotation's perturbation (radians about the parent's axes)."""
    if estimate.covariance is None:
        return [None] * len(J)
    variance = np.einsum("ij,jk,ik->i", J, estimate.covariance[:3, :3], J)
    return [float(s) for s in np.sqrt(np.maximum(variance, 0.0))]


def _method_row(name: str, method: MethodResult, reference: Array | None) -> MethodRow:
    mm = deg = None
    if method.matrix is not None and reference is not None:
        mm, deg = map(float, se3.deviation(reference, method.matrix))
    return MethodRow(name, method.loop_rms_mm, method.loop_rms_deg, mm, deg, method.message)
