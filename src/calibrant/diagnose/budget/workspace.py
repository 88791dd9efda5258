"""Uncertainty where the robot works: of the camera, and of a point that the camera sees, anywhere in a volume.

A camera sees the point at a pixel u and at a known distance along its axis (a depth sensor, a plane, a known size):

    p_base = T_base_camera p,    p = z ray(u; theta)

    d p_base = [-hat(R p), I] dT + R [-(dproject/dp_xy)^-1 dproject/dtheta; 0] dtheta

with R the rotation of T_base_camera. Camera and mounting are taken with their joint covariance: an error of the
principal point that the mounting has absorbed cancels again where the camera works as it was calibrated.

eye-to-hand: the camera stands still. eye-in-hand: it looks from the calibration's own poses, in root mean square over
those that have the point in the image; where none has, it is brought there as it stood before the board.

The figure of a point is its 1 sigma along its worst direction, and the radius that holds 95 % of its errors: that of a
scaled chi-square with the same mean and variance as |N(0, C)|^2 (Satterthwaite 1946).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import DEFAULT_CAMERA, CalibrationResult, Check, Measured, verdict_of
from calibrant.diagnose.budget.cell import TARGET, TARGET_SIGMA, CameraBudget, ErrorBudget, cell_budgets
from calibrant.diagnose.budget.volume import (
    STEPS,
    Volume,
    check_request,
    is_workspace_check,
    parse_fraction,
    parse_volume,
)
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.targets.lengths import parse_length

CONFIDENCE = 0.95


@dataclass(frozen=True, eq=False)
class PlaceUncertainty:
    """A point (3,) in the base, metres: 1 sigma along its worst direction, the 95 % radius, shares of each source.

    shares: part of the variance (mean over all directions) by source; they sum to 1.
    """

    point: Array
    sigma_mm: float
    radius_mm: float
    shares: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class WorkspaceUncertainty:
    """The uncertainty over a grid of points (nx, ny, nz, 3), metres, base frame.

    covariances: by source, (nx, ny, nz, 3, 3) square metres; visible (nx, ny, nz): in the image of the camera where it
    stands (eye-to-hand), or from one of the calibration's poses (eye-in-hand). centre: of the volume's middle.
    camera_mm, camera_deg: 1 sigma of the camera itself along its worst direction; for eye-in-hand in the gripper;
    camera_sized_mm: the same, with the target's size taken as given.
    target_sigma: relative RMS error of the target's size that the figures contain. base: the frame of the volume.
    """

    volume: Volume
    points: Array
    covariances: Mapping[str, Array]
    visible: NDArray[np.bool_]
    centre: PlaceUncertainty
    camera_mm: float
    camera_deg: float
    camera_sized_mm: float
    camera_parent: str
    target_sigma: float
    notes: tuple[str, ...]
    base: str = "base"

    @cached_property
    def covariance(self) -> Array:
        """All sources, (nx, ny, nz, 3, 3) square metres."""
        return np.sum(list(self.covariances.values()), axis=0)

    @cached_property
    def sigma_mm(self) -> Array:
        """1 sigma along the worst direction, (nx, ny, nz)."""
        return sigma_mm(self.covariance)

    @cached_property
    def radius_mm(self) -> Array:
        """Radius that holds 95 % of the errors, (nx, ny, nz)."""
        return radius_mm(self.covariance)

    @property
    def mean_mm(self) -> float:
        """Root mean square of sigma over the volume."""
        return float(np.sqrt(np.mean(self.sigma_mm**2)))

    @cached_property
    def worst(self) -> PlaceUncertainty:
        """The point with the largest 95 % radius."""
        index = np.unravel_index(int(np.argmax(self.radius_mm)), self.radius_mm.shape)
        return _place(self.points[index], {name: C[index] for name, C in self.covariances.items()})


def workspace_uncertainty(
    result: CalibrationResult,
    volume: Volume,
    *,
    target_sigma: float = TARGET_SIGMA,
    steps: Sequence[int] = STEPS,
) -> WorkspaceUncertainty:
    """The uncertainty of what the camera sees in a volume of the base frame, from the result's file alone.

    Args: target_sigma, relative 1 sigma of the target's size. Raises: InputError as `error_budget`, or when no point
    of the volume can be seen; RefusedError where the motions do not determine the result.
    """
    own = next(iter(cell_budgets(result, target_sigma=target_sigma).values()))
    return _in_volume(own, volume, steps)


def workspace_of_cameras(
    result: CalibrationResult, volume: Volume, *, target_sigma: float = TARGET_SIGMA, steps: Sequence[int] = STEPS
) -> dict[str, WorkspaceUncertainty]:
    """The same for every camera of a result, by name. Cameras on a robot that is not the first are told in the base of
    their own robot.

    Raises: InputError as `workspace_uncertainty`, naming the camera; or where joints were free.
    """
    own = cell_budgets(result, target_sigma=target_sigma)
    if len(own) == 1:
        (one,) = own.values()
        return {next(iter(result.cameras), DEFAULT_CAMERA): _in_volume(one, volume, steps)}
    out = {}
    for name, one in own.items():
        try:
            out[name] = _in_volume(one, volume, steps)
        except InputError as error:
            raise InputError(f"camera {name}: {error}") from error
    return out


def _in_volume(own: CameraBudget, volume: Volume, steps: Sequence[int]) -> WorkspaceUncertainty:
    budget, looks = own.budget, own.looks
    points = volume.grid(steps)
    flat = points.reshape(-1, 3)
    covariances, visible = _seen(budget, looks, np.vstack([flat, volume.centre]))
    shape = points.shape[:3]
    X = {name: C[:6, :6] for name, C in budget.sources.items()}
    total = np.sum(list(X.values()), axis=0)
    return WorkspaceUncertainty(
        volume,
        points,
        {name: C[:-1].reshape(*shape, 3, 3) for name, C in covariances.items()},
        visible[:-1].reshape(shape),
        _place(volume.centre, {name: C[-1] for name, C in covariances.items()}),
        float(sigma_mm(total[3:, 3:])),
        float(np.rad2deg(1e-3 * sigma_mm(total[:3, :3]))),
        float(sigma_mm((total - X.get(TARGET, np.zeros((6, 6))))[3:, 3:])),
        budget.setup.camera_parent,
        budget.target_sigma,
        budget.notes,
        own.parent,
    )


def sigma_mm(C: Array) -> Array:
    """1 sigma along the worst direction, millimetres: root of the largest eigenvalue of C (..., 3, 3), metres^2."""
    return 1e3 * np.sqrt(np.maximum(np.linalg.eigvalsh(C)[..., -1], 0.0))


def radius_mm(C: Array, confidence: float = CONFIDENCE) -> Array:
    """Radius that holds a share of the errors N(0, C), millimetres; C (..., 3, 3) metres^2. See the module."""
    from scipy.special import gammaincinv  # heavy, and needed only where a workspace was asked for

    values = np.maximum(np.linalg.eigvalsh(C), 0.0)
    first = values.sum(axis=-1)
    second = np.maximum(np.sum(values**2, axis=-1), np.finfo(float).tiny)
    freedom = np.maximum(first**2 / second, 1.0)
    return 1e3 * np.sqrt(second / np.maximum(first, np.finfo(float).tiny) * 2 * gammaincinv(freedom / 2, confidence))


def point_jacobian(X: Array, camera: Camera | None, p_camera: Array, T_base_parent: Array) -> Array:
    """d p_base / d (X, Z, camera), (..., 3, 12 + k), of points p_camera (..., 3) seen at a known distance.

    X (4, 4): T_parent_camera; camera: None for pose pairs, k is 0 then; T_base_parent (..., 4, 4): where the camera's
    parent is, the identity for eye-to-hand.
    """
    p = np.asarray(p_camera)
    k = 0 if camera is None else len(camera.values)
    J = np.zeros((*np.broadcast_shapes(p.shape[:-1], T_base_parent.shape[:-2]), 3, 12 + k))
    R_parent, R = T_base_parent[..., :3, :3], X[:3, :3]
    J[..., :3] = -R_parent @ so3.hat(p @ R.T)
    J[..., 3:6] = R_parent
    if camera is not None:
        flat = p.reshape(-1, 3)
        _, J_point, J_camera = camera.model.project_with_jacobians(camera.values, flat)
        moved = -np.linalg.solve(J_point[:, :, :2], J_camera).reshape(*p.shape[:-1], 2, k)
        J[..., 12:] = (R_parent @ R)[..., :, :2] @ moved
    return J


def workspace_check(found: WorkspaceUncertainty, *, tolerance: float | None = None) -> Check:
    """Check "workspace": whether 95 % of the errors at the worst place stay within the tolerance, metres.

    Without a tolerance the check states the figures. Its value is the 95 % radius at the worst place, millimetres.
    """
    worst = found.worst
    where = ", ".join(f"{1e3 * c:.0f}" for c in worst.point)
    frame = "" if found.base == "base" else f" in the frame {found.base}"
    text = (
        f"a point that the camera sees{frame} is known to {worst.sigma_mm:.2g} mm (1 sigma, worst direction) at the "
        f"worst place of the volume ({where} mm), {found.mean_mm:.2g} mm on average, {found.centre.sigma_mm:.2g} mm "
        f"in its middle; 95 % of the errors stay below {worst.radius_mm:.2g} mm. {budget_words(worst.shares)}"
    )
    unseen = 1 - float(found.visible.mean())
    if unseen > 0:
        text += f" {100 * unseen:.0f} % of the volume {_UNSEEN[found.camera_parent]}."
    if tolerance is None:
        return Check("workspace", "ok", text, worst.radius_mm)
    passed = worst.radius_mm <= 1e3 * tolerance
    verdict = "within" if passed else "NOT within"
    words = f"{verdict} the tolerance of {1e3 * tolerance:g} mm: {text}"
    return Check("workspace", "ok" if passed else "fail", words, worst.radius_mm)


_UNSEEN = {
    "base": "lies outside the camera's image, where the figures are extrapolated",
    "gripper": "was seen from no pose of the calibration; there the camera is taken to look as it looked at the board",
}


def budget_words(shares: Mapping[str, float]) -> str:
    """The shares of the variance in words, the largest first; below half a percent they are left out."""
    parts = [f"{name} {100 * s:.0f} %" for name, s in sorted(shares.items(), key=lambda x: -x[1]) if s >= 0.005]
    return f"Of its variance: {', '.join(parts)}."


def with_workspace(
    result: CalibrationResult, workspace: str, *, tolerance: str | None = None, target_sigma: str | None = None
) -> CalibrationResult:
    """The result with the check "workspace" and, in its options, what was asked, so that a report can draw the map.

    Args: as on the command line: a volume, a length, percent. Raises: InputError as `workspace_uncertainty`.
    """
    check_request(workspace, tolerance, target_sigma)
    volume = parse_volume(workspace)
    sigma = TARGET_SIGMA if target_sigma is None else parse_fraction(target_sigma, what="--target-sigma")
    found = workspace_of_cameras(result, volume, target_sigma=sigma)
    bound = None if tolerance is None else parse_length(tolerance, what="--tolerance")
    answers = [workspace_check(one, tolerance=bound) for one in found.values()]
    if len(found) > 1:
        answers = [
            replace(c, name=f"workspace-{name}", message=f"{name}: {c.message}") for name, c in zip(found, answers)
        ]
    checks = (*(c for c in result.checks if not is_workspace_check(c)), *answers)
    asked = {"workspace": workspace, "tolerance": tolerance, "target_sigma": f"{100 * sigma:g}%"}
    options = {**result.options, **{key: value for key, value in asked.items() if value is not None}}
    figures = {**result.figures, **_workspace_figures(found)}
    return replace(result, checks=checks, verdict=verdict_of(checks), options=options, figures=figures)


def _workspace_figures(found: Mapping[str, WorkspaceUncertainty]) -> dict[str, Measured]:
    """1 sigma and the radius that holds 95 %, at the worst place; by camera, where there are several."""
    out = {}
    for name, one in found.items():
        of = f" {name}" if len(found) > 1 else ""
        out[f"workspace_sigma{of}"] = Measured(one.worst.sigma_mm, unit="mm")
        out[f"workspace_radius{of}"] = Measured(one.worst.radius_mm, unit="mm")
    return out


def asked_workspace(result: CalibrationResult) -> dict[str, WorkspaceUncertainty]:
    """The uncertainty of each camera in the workspace that the result's options name; empty where they name none."""
    workspace, sigma = result.options.get("workspace"), result.options.get("target_sigma")
    if not isinstance(workspace, str) or not isinstance(sigma, str):
        return {}
    volume, size = parse_volume(workspace), parse_fraction(sigma, what="target_sigma")
    return workspace_of_cameras(result, volume, target_sigma=size)


def _place(point: Array, covariances: Mapping[str, Array]) -> PlaceUncertainty:
    total = np.sum(list(covariances.values()), axis=0)
    variance = max(float(np.trace(total)), np.finfo(float).tiny)
    shares = {name: float(np.trace(C)) / variance for name, C in covariances.items()}
    return PlaceUncertainty(np.asarray(point), float(sigma_mm(total)), float(radius_mm(total)), shares)


def _seen(
    budget: ErrorBudget, looks: tuple[Array, Array] | None, points: Array
) -> tuple[dict[str, Array], NDArray[np.bool_]]:
    """Covariance (m, 3, 3) of base points (m, 3) by source, and whether they are in an image.

    looks: for a camera on a gripper, as in `CameraBudget`.
    """
    if looks is None:
        p = se3.apply(se3.inverse(budget.X), points)
        seen = _in_image(budget, p)
        if not np.any(p[:, 2] > 0):
            raise InputError("the whole workspace lies behind the camera; check its coordinates: base frame, x, y, z")
        # Behind the camera there is no pixel to speak of: such points are taken on its axis, and told as unseen.
        p = np.where(p[:, 2:] > 0, p, [0.0, 0.0, 1.0])
        usable = np.where(seen[:, None], p, _on_axis(p))
        return budget.propagate(point_jacobian(budget.X, budget.camera, usable, np.eye(4))), seen
    robot, brought = looks
    T_base_camera = robot @ budget.X
    p = se3.apply(se3.inverse(T_base_camera)[:, None], points)
    seen = _in_image(budget, p)
    anywhere = np.asarray(seen.any(axis=0))
    # Where no pose of the calibration has the point, every pose looks at it as it looked at the board's middle.
    weight = np.where(anywhere, seen, True)
    p = np.where(seen[..., None], p, brought[:, None])
    J = point_jacobian(budget.X, budget.camera, p, robot[:, None])
    share = weight / weight.sum(axis=0)
    return {name: np.einsum("nm,nmij->mij", share, C) for name, C in budget.propagate(J).items()}, anywhere


def _on_axis(p: Array) -> Array:
    """The points at the same distance on the camera's axis, where every camera model holds."""
    return np.linalg.norm(p, axis=-1, keepdims=True) * np.array([0.0, 0.0, 1.0])


def _in_image(budget: ErrorBudget, p: Array) -> NDArray[np.bool_]:
    """Which points in the camera frame (..., 3) fall into the image; without a camera, all in front of it."""
    if budget.camera is None:
        return p[..., 2] > 0
    with np.errstate(invalid="ignore"):
        uv = budget.camera.project(p)
        size = np.array(budget.camera.image_size)
        inside = np.all((uv > -0.5) & (uv < size - 0.5), axis=-1)
    # Beyond its valid field a distorted camera's pixels fold back into the image.
    return np.asarray(inside & budget.camera.model.valid(budget.camera.values, p))
