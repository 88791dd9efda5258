"""The joint refinement: camera transform, target transform and a correction of every robot pose, weighted.

    images   min sum |project(theta, X^-1 A_i^-1 Z p_j) - uv_ij|^2 / sigma_px^2
                 + |log(R_i R_measured_i^T)|^2 / sigma_rot^2 + |t_i - t_measured_i|^2 / sigma_trans^2

over X, Z, the robot's true poses A_i, and the camera when the same images made it (or with its covariance as a prior).
Assuming the robot exact (no correction) is worse than a closed form as soon as the robot's noise outweighs the
pixels'; the noise levels that decide this are estimated with the rest (`optimize.noise`).

Measured target poses in place of images: `calibrate.pose_pairs`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calibrant.calibrate.cell.problem.pose_pairs import FLANGE_ROTATION, SCALE, TARGET_ROTATION, TARGET_TRANSLATION
from calibrant.calibrate.reprojection.factor import ReprojectionFactor, TargetModes, stack
from calibrant.calibrate.reprojection.links import Link
from calibrant.calibrate.solvers.setup import Setup
from calibrant.cameras import Camera
from calibrant.data import View
from calibrant.optimize.factors import Factor, RotationPrior, TranslationPrior, VectorPrior
from calibrant.optimize.manifolds import SE3, Euclidean, Variable
from calibrant.optimize.problem import Problem

Array = NDArray[np.float64]

PIXEL, ROBOT_ROTATION, ROBOT_TRANSLATION = "pixel", "robot rotation", "robot translation"

FLOORS = {
    PIXEL: 1e-4,
    ROBOT_ROTATION: 1e-6,
    ROBOT_TRANSLATION: 1e-7,
    TARGET_ROTATION: 1e-9,
    TARGET_TRANSLATION: 1e-10,
    FLANGE_ROTATION: 1e-9,
}
"""Noise worth telling from none: pixels, radians, metres. No detector or robot comes within 100 times of these."""


@dataclass(frozen=True, eq=False)
class CameraRole:
    """How the camera enters: its start, names of held parameters, and the square root information of a prior.

    extra: views without a robot pose that help to determine the camera, with their start poses.
    """

    camera: Camera
    held: tuple[str, ...]
    prior: Array | None = None
    extra: tuple[View, ...] = ()
    extra_poses: Array = field(default_factory=lambda: np.zeros((0, 4, 4)))


def held_camera(camera: Camera) -> CameraRole:
    """The camera as it is: exact."""
    return CameraRole(camera, camera.model.parameter_names)


def prior_camera(camera: Camera) -> CameraRole:
    """The camera within its own covariance; parameters without variance are held."""
    if camera.covariance is None:
        return held_camera(camera)
    names = camera.model.parameter_names
    variance = np.diag(camera.covariance)
    free = variance > 0
    if not free.any():
        return held_camera(camera)
    information = np.linalg.inv(camera.covariance[np.ix_(free, free)])
    root = np.zeros((int(free.sum()), len(names)))
    root[:, free] = np.linalg.cholesky(information).T
    return CameraRole(camera, tuple(n for n, f in zip(names, free) if not f), root)


def image_problem(
    setup: Setup,
    views: Sequence[View],
    T_base_gripper: Array,
    role: CameraRole,
    *,
    X: Array,
    Z: Array,
    sigmas: Mapping[str, float],
    free_scale: bool = False,
) -> Problem:
    """The problem over images; `free_scale` adds the target's scale to the unknowns."""
    n = len(views)
    stacked = stack(views)
    model = role.camera.model
    modes = TargetModes(SCALE, stacked.points[None])
    # The mode's amplitude is scale - 1: points + (s - 1) points.
    variables = [
        Variable(setup.camera_transform, SE3(), X[None]),
        Variable(setup.target_transform, SE3(), Z[None]),
        Variable("T_base_gripper", SE3(), T_base_gripper),
        Variable("camera", Euclidean(model.parameter_names, role.held), role.camera.values[None]),
    ]
    if free_scale:
        variables.append(Variable(SCALE, Euclidean(("scale",)), np.zeros((1, 1))))
    factors: list[Factor] = [
        ReprojectionFactor(
            "reprojection",
            model=model,
            camera="camera",
            links=setup.links(np.arange(n)),
            views=stacked,
            modes=modes if free_scale else None,
            noise=PIXEL,
        ),
        RotationPrior("robot rotation", "T_base_gripper", T_base_gripper, noise=ROBOT_ROTATION),
        TranslationPrior("robot translation", "T_base_gripper", T_base_gripper, noise=ROBOT_TRANSLATION),
    ]
    if role.prior is not None:
        factors.append(VectorPrior("camera prior", "camera", 0, role.camera.values, sqrt_information=role.prior))
    if role.extra:
        variables.append(Variable("T_camera_target", SE3(), role.extra_poses))
        factors.append(
            ReprojectionFactor(
                "reprojection without robot pose",
                model=model,
                camera="camera",
                links=[Link("T_camera_target", np.arange(len(role.extra)))],
                views=stack(role.extra),
                noise=PIXEL,
            )
        )
    return Problem(tuple(variables), tuple(factors), sigmas)
