"""The joint problem of dynamic calibration: its variables, factors and noise sources. See `dynamic`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.reprojection.factor import ReprojectionFactor, stack
from calibrant.calibrate.reprojection.links import Link
from calibrant.cameras import Camera
from calibrant.data import TransformEstimate, View
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.optimize.factors import Factor, RotationPrior, TranslationPrior
from calibrant.optimize.manifolds import SE3, Euclidean, Variable
from calibrant.optimize.problem import Problem, Values
from calibrant.optimize.solution import Solution

PLACE, MOUNTING, TARGET, ROBOT_POSES = "T_base_external", "T_gripper_wrist", "T_base_target", "T_base_gripper"
WRIST, EXTERNAL = "wrist camera", "external camera"

WRIST_CALIBRATION, EXTERNAL_INTRINSICS = "wrist calibration", "external intrinsics"
WRIST_PIXELS, EXTERNAL_PIXELS, ROBOT = "wrist pixels", "external pixels", "robot"
_ROTATION, _TRANSLATION = "robot rotation", "robot translation"
SOURCES = (WRIST_CALIBRATION, EXTERNAL_INTRINSICS, WRIST_PIXELS, EXTERNAL_PIXELS, ROBOT)
GROUPS_OF: Mapping[str, tuple[str, ...]] = {s: (s,) for s in SOURCES[:4]} | {ROBOT: (_ROTATION, _TRANSLATION)}


@dataclass(frozen=True, eq=False)
class WristCamera:
    """A calibrated camera on the gripper: T_gripper_camera, and the joint covariance (6 + k, 6 + k) of it and the lens.

    Without their correlations, the transform's and the camera's covariances stand on its diagonal (`uncorrelated`).
    """

    camera: Camera
    T_gripper_camera: Array
    covariance: Array

    def __post_init__(self) -> None:
        size = 6 + len(self.camera.values)
        if np.shape(self.covariance) != (size, size):
            raise InputError(
                f"the joint covariance of mounting and camera is ({size}, {size}), got {np.shape(self.covariance)}"
            )
        object.__setattr__(self, "T_gripper_camera", se3.check(self.T_gripper_camera, name="T_gripper_camera"))

    @classmethod
    def uncorrelated(cls, camera: Camera, mounting: TransformEstimate) -> WristCamera:
        """From a camera file and a transform whose errors are independent."""
        k = len(camera.values)
        C = np.zeros((6 + k, 6 + k))
        C[:6, :6] = 0.0 if mounting.covariance is None else mounting.covariance
        C[6:, 6:] = 0.0 if camera.covariance is None else camera.covariance
        return cls(camera, mounting.matrix, C)


@dataclass(frozen=True, eq=False)
class Sight:
    """A view of the target in its placement number `target`, from robot pose number `robot` or place number `place`."""

    view: View
    target: int
    robot: int | None = None
    place: int | None = None


class MountingPrior(Factor):
    """Mounting and wrist camera within their joint covariance: r = L^T (X - X_0, theta - theta_0), L L^T = C^-1."""

    def __init__(self, wrist: WristCamera) -> None:
        self.wrist = wrist
        free = np.diag(wrist.covariance) > 0
        information = np.linalg.inv(wrist.covariance[np.ix_(free, free)])
        self.root = np.zeros((int(free.sum()), len(free)))
        self.root[:, free] = np.linalg.cholesky(information).T
        one = np.zeros(1, dtype=np.int64)
        super().__init__(
            WRIST_CALIBRATION,
            variables=(MOUNTING, WRIST),
            indices=(one, one),
            dim=len(self.root),
            noise=WRIST_CALIBRATION,
        )

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        X, theta = values
        delta = se3.local(self.wrist.T_gripper_camera, X)
        off = np.concatenate([delta, theta - self.wrist.camera.values], axis=-1)
        J = self.root[None, :, :6].copy()
        J[..., :3] = J[..., :3] @ so3.left_jacobian_inverse(delta[:, :3])
        return off @ self.root.T, (J, self.root[None, :, 6:])


class LensPrior(Factor):
    """The external camera within its covariance: r = L^T (theta - theta_0)."""

    def __init__(self, camera: Camera, covariance: Array) -> None:
        self.mean = camera.values
        free = np.diag(covariance) > 0
        self.root = np.zeros((int(free.sum()), len(free)))
        self.root[:, free] = np.linalg.cholesky(np.linalg.inv(covariance[np.ix_(free, free)])).T
        one = np.zeros(1, dtype=np.int64)
        super().__init__(
            EXTERNAL_INTRINSICS, variables=(EXTERNAL,), indices=(one,), dim=len(self.root), noise=EXTERNAL_INTRINSICS
        )

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        return (values[0] - self.mean) @ self.root.T, (self.root[None],)


def levels(wrist_px: float, external_px: float, rotation: float, translation: float) -> dict[str, float]:
    """Noise levels of all groups; the priors are in units of their own sigma."""
    pixels = {WRIST_PIXELS: wrist_px, EXTERNAL_PIXELS: external_px}
    return {**pixels, _ROTATION: rotation, _TRANSLATION: translation, WRIST_CALIBRATION: 1.0, EXTERNAL_INTRINSICS: 1.0}


def problem_of(
    wrist: WristCamera,
    external: Camera,
    sights: Sequence[Sight],
    robot: Array,
    targets: Array,
    places: Array,
    *,
    levels: Mapping[str, float],
) -> Problem:
    """The problem over all views so far; robot (n, 4, 4), targets (m, 4, 4), places (p, 4, 4) are start values."""
    near = [s for s in sights if s.robot is not None]
    far = [s for s in sights if s.place is not None]
    mounting = np.diag(wrist.covariance)
    variables = [
        Variable(MOUNTING, SE3(), wrist.T_gripper_camera[None], constant=not np.all(mounting[:6] > 0)),
        Variable(ROBOT_POSES, SE3(), robot),
        Variable(TARGET, SE3(), targets),
        _lens(WRIST, wrist.camera, mounting[6:]),
    ]
    once, rows = np.zeros(len(near), dtype=np.int64), _indices([s.robot for s in near])
    to_wrist = [Link(MOUNTING, once, inverted=True), Link(ROBOT_POSES, rows, inverted=True)]
    factors: list[Factor] = [
        _sight_factor(WRIST_PIXELS, wrist.camera, WRIST, to_wrist, near),
        RotationPrior(_ROTATION, ROBOT_POSES, robot, noise=_ROTATION),
        TranslationPrior(_TRANSLATION, ROBOT_POSES, robot, noise=_TRANSLATION),
    ]
    if np.any(mounting > 0):
        factors.append(MountingPrior(wrist))
    if far:
        covariance = np.zeros((len(external.values),) * 2) if external.covariance is None else external.covariance
        variables += [Variable(PLACE, SE3(), places), _lens(EXTERNAL, external, np.diag(covariance))]
        link = Link(PLACE, _indices([s.place for s in far]), inverted=True)
        factors.append(_sight_factor(EXTERNAL_PIXELS, external, EXTERNAL, [link], far))
        if np.any(covariance > 0):
            factors.append(LensPrior(external, covariance))
    return Problem(tuple(variables), tuple(factors), {f.noise: levels[f.noise] for f in factors})


def start_of(problem: Problem, before: Solution | None) -> Values:
    """The problem's start, with the values of the last solution where it has them."""
    if before is None:
        return problem.start
    known = {v.name: value for v, value in zip(before.problem.variables, before.values)}
    return tuple(
        np.concatenate([known[v.name], v.values[len(known[v.name]) :]]) if v.name in known else v.values
        for v in problem.variables
    )


def fitted_camera(camera: Camera, solution: Solution | None, name: str) -> Camera:
    """The camera with the parameters and the covariance of the solution, where it has them."""
    if solution is None or name not in [v.name for v in solution.problem.variables]:
        return camera
    return Camera(camera.model, camera.image_size, solution.value(name)[0], solution.covariance(name))


def _lens(name: str, camera: Camera, variance: Array) -> Variable:
    names = camera.model.parameter_names
    held = tuple(n for n, v in zip(names, variance) if not v > 0)
    return Variable(name, Euclidean(names, held), camera.values[None])


def _indices(numbers: Sequence[int | None]) -> NDArray[np.int64]:
    return np.array(numbers, dtype=np.int64)


def _sight_factor(
    name: str, camera: Camera, variable: str, towards: Sequence[Link], sights: Sequence[Sight]
) -> ReprojectionFactor:
    links = [*towards, Link(TARGET, _indices([s.target for s in sights]))]
    views = stack([s.view for s in sights])
    return ReprojectionFactor(name, model=camera.model, camera=variable, links=links, views=views, noise=name)
