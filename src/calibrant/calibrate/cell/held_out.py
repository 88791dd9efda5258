"""Held-out error: calibrate without a pose, then ask where that pose sees the target.

Every pose is held out once, alone up to `ALONE` poses and in `GROUPS` groups beyond. The noise levels stay those of the
full fit; the solve starts from it, and where one step leads to its end that step is the full fit's equations less what
the poses held out have in them (`fit_without`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.calibrate.cell.problem.camera_role import CameraRole, image_problem
from calibrant.calibrate.cell.problem.fit_without import pose_shares
from calibrant.calibrate.cell.problem.pose_pairs import pose_pair_problem
from calibrant.calibrate.solvers.setup import Setup
from calibrant.cameras import Camera
from calibrant.data import HeldOut, View
from calibrant.geometry import se3
from calibrant.optimize import linear
from calibrant.optimize.levenberg_marquardt import SolverOptions, solve
from calibrant.optimize.problem import Problem, Values
from calibrant.optimize.solution import Solution

Array = NDArray[np.float64]

ALONE = 30
GROUPS = 10
"""A tenth less data changes the errors of more than thirty poses by a twentieth at most: no need to go one by one."""
CLOSE_ENOUGH = SolverOptions(cost_tolerance=1e-7)
"""A fit this close to its end is off by 1e-3 of its own sigma (cost of n residuals, n up to 1e5)."""
NEAR = 5.0
"""Decrease of the cost, half of the squared distance in sigmas: within three sigma the problem is as good as linear, as
a sigma is thousandths of the distances and angles that it is bent by."""


@dataclass(frozen=True, eq=False)
class PoseErrors:
    """Held-out errors of each pose (n,): target position, mm, and rotation, deg, in its parent frame; pixels rms."""

    mm: Array
    deg: Array
    px: Array | None

    @property
    def rms(self) -> HeldOut:
        """Root mean square over the poses, which weigh alike: over all points, full boards would weigh more."""
        px = None if self.px is None else float(np.sqrt(np.mean(self.px**2)))
        return HeldOut(float(np.sqrt(np.mean(self.mm**2))), float(np.sqrt(np.mean(self.deg**2))), px)


def leave_out(
    setup: Setup,
    T_base_gripper: Array,
    B: Array,
    views: Sequence[View] | None,
    role: CameraRole,
    fit: Solution,
    sigmas: Mapping[str, float],
) -> PoseErrors:
    """Held-out errors of all poses."""
    n = len(B)
    groups = np.arange(n) % (n if n <= ALONE else GROUPS)
    # Views without a robot pose start where they were found, not where the fit put them: no step from the fit's end.
    shares = None if role.extra else pose_shares(fit, "T_base_gripper")
    mm, deg, px = np.empty(n), np.empty(n), np.empty(n)
    for fold in range(int(groups.max()) + 1):
        out = groups == fold
        end = None if shares is None else shares.without(out)
        if end is not None and end[1] <= NEAR:
            X, Z, camera = _unknowns(setup, role, fit.problem, end[0], of_images=views is not None)
        else:
            X, Z, camera = _fit_without(setup, T_base_gripper, B, views, role, fit, sigmas, out)
        A = setup.normal_form(T_base_gripper[out])
        delta = se3.local(Z, A @ X @ B[out])
        deg[out] = np.rad2deg(np.linalg.norm(delta[:, :3], axis=1))
        mm[out] = 1e3 * np.linalg.norm(delta[:, 3:], axis=1)
        if views is not None:
            predicted = se3.inverse(X) @ se3.inverse(A) @ Z
            px[out] = [rms_px(camera, views[int(i)], T) for i, T in zip(np.flatnonzero(out), predicted)]
    return PoseErrors(mm, deg, px if views is not None else None)


def _fit_without(
    setup: Setup,
    T_base_gripper: Array,
    B: Array,
    views: Sequence[View] | None,
    role: CameraRole,
    fit: Solution,
    sigmas: Mapping[str, float],
    out: NDArray[np.bool_],
) -> tuple[Array, Array, Camera]:
    """Camera and target transform and the camera of a fit without the poses `out`, where one step does not lead."""
    X, Z = fit.value(setup.camera_transform)[0], fit.value(setup.target_transform)[0]
    keep = ~out
    if views is None:
        problem = pose_pair_problem(setup, T_base_gripper[keep], B[keep], X=X, Z=Z, sigmas=sigmas)
        start = list(problem.start)
    else:
        kept = [v for v, k in zip(views, keep) if k]
        problem = image_problem(setup, kept, T_base_gripper[keep], role, X=X, Z=Z, sigmas=sigmas)
        start = list(problem.start)
        start[problem.variable_index("camera")] = fit.value("camera")
    start[problem.variable_index("T_base_gripper")] = fit.value("T_base_gripper")[keep]
    return _unknowns(setup, role, problem, _end(problem, tuple(start)), of_images=views is not None)


def _unknowns(
    setup: Setup, role: CameraRole, problem: Problem, values: Values, *, of_images: bool
) -> tuple[Array, Array, Camera]:
    X, Z = (values[problem.variable_index(name)][0] for name in (setup.camera_transform, setup.target_transform))
    if not of_images:
        return X, Z, role.camera
    return X, Z, Camera(role.camera.model, role.camera.image_size, values[problem.variable_index("camera")][0])


def _end(problem: Problem, start: Values) -> Values:
    """Where the fit ends: one Gauss-Newton step away, unless what was left out had a large say."""
    step = linear.solve(problem.linearize(start, problem.sigmas), 0.0)
    if step is not None and step.predicted <= NEAR:
        return problem.retract(start, step)
    return solve(problem, start=start, options=CLOSE_ENOUGH).values


def rms_px(camera: Camera, view: View, T_camera_target: Array) -> float:
    """Distance between predicted and observed pixels of a view; points behind the camera count as an image's width."""
    d = camera.project(se3.apply(T_camera_target, view.points)) - view.uv
    d = np.where(np.isfinite(d), d, float(camera.image_size[0]))
    return float(np.sqrt(np.mean(np.sum(d * d, axis=1))))
