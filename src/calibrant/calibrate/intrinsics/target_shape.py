"""The target's own shape: boards that are not flat, estimated with the camera.

    paraboloid   z += a (1 - x^2) + b (1 - y^2) + c x y, x and y in -1 … 1 across the board: mrcal's two modes, and the
                 twist, without which a sheet bends along its own edges only
    free         every point of the target on its own, as OpenCV's calibrateCameraRO

Free points leave seven directions open, for turning, moving and scaling the board turns, moves and scales the poses and
changes no pixel. They are closed by holding two far points and one coordinate of a third; what is reported is the shape
after the similarity that brings it closest to the nominal one, so that the choice of points does not show. A camera's
parameters do not depend on the choice either.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.calibrate.classical import planar as planar_start
from calibrant.calibrate.reprojection.factor import ReprojectionFactor, StackedViews, TargetModes
from calibrant.calibrate.reprojection.links import Link
from calibrant.cameras import CameraModel
from calibrant.data import View
from calibrant.data.details import BentTarget, FreeTarget
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.optimize import SE3, Euclidean, Factor, Manifold, Problem, Solution, Variable, VectorPrior, solve

FLAT = "flat"
BEND, POINTS = "target shape", "target points"
GAUGE_SIGMA_M = 1e-9
"""Held coordinates, against a pixel of noise: nothing pulls at them, so any small figure holds them exactly."""
GAUGE_EQUATIONS = 7


@dataclass(frozen=True, eq=False)
class Shaped:
    """A fit with the target's shape in it.

    T_camera_target (m, 4, 4); shape: in numbers, sigmas at unit noise; gauge_equations: those that are no data.
    """

    solution: Solution
    T_camera_target: Array
    shape: BentTarget | FreeTarget
    gauge_equations: int


@dataclass(frozen=True, eq=False)
class Flat:
    """The flat fit that a shape starts from."""

    solution: Solution
    views: tuple[View, ...]
    stacked: StackedViews
    model: CameraModel


def shape_of(name: str) -> Callable[[Flat], Shaped]:
    """The estimator of that name. Raises: InputError listing the names there are."""
    if name not in SHAPES:
        raise InputError(f"unknown target shape {name!r}; known: {', '.join((FLAT, *SHAPES))}")
    return SHAPES[name]


def with_noise(shape: BentTarget | FreeTarget, sigma_px: float) -> BentTarget | FreeTarget:
    """The shape with its sigmas, which belong to unit noise, at the noise found."""
    if isinstance(shape, FreeTarget):
        return replace(shape, typical_sigma_mm=shape.typical_sigma_mm * sigma_px)
    across, down = shape.bend_sigma_mm
    twist = shape.twist_sigma_mm * sigma_px
    return replace(shape, bend_sigma_mm=(across * sigma_px, down * sigma_px), twist_sigma_mm=twist)


def _variables(flat: Flat) -> tuple[Variable, Variable, Manifold]:
    """Poses and camera, starting from the flat fit."""
    problem = flat.solution.problem
    manifold = problem.variables[problem.variable_index("camera")].manifold
    poses = Variable("T_camera_target", SE3(), flat.solution.value("T_camera_target"))
    return poses, Variable("camera", manifold, flat.solution.value("camera")), manifold


def paraboloid(flat: Flat) -> Shaped:
    """Three modes: the board's middle against its edges, along each of its axes, and its corners against each other."""
    points = flat.stacked.points
    planar = planar_start.in_plane(points)
    low, high = planar.xy.min(axis=0), planar.xy.max(axis=0)
    across = 2 * (planar.xy - low) / (high - low) - 1
    normal = planar.T_plane_target[2, :3]
    modes = np.stack([1 - across[:, 0] ** 2, 1 - across[:, 1] ** 2, across[:, 0] * across[:, 1]])
    directions = modes[:, :, None] * normal
    factor = ReprojectionFactor(
        "reprojection",
        model=flat.model,
        camera="camera",
        links=[Link("T_camera_target", np.arange(len(flat.views)))],
        views=flat.stacked,
        modes=TargetModes(BEND, directions),
    )
    poses, camera, _ = _variables(flat)
    names = ("bend across columns", "bend across rows", "twist")
    bend = Variable(BEND, Euclidean(names), np.zeros((1, 3)), words="the target")
    solution = solve(Problem((poses, camera, bend), (factor, *_priors(flat))))
    if solution.unobservable:
        raise RefusedError(f"the target's shape is not determined: {solution.unobservable[0].message}")
    values, sigma = solution.value(BEND)[0], np.sqrt(np.diag(solution.covariance(BEND)))
    columns, rows, twist = (1e3 * values).tolist()
    sigma_columns, sigma_rows, sigma_twist = (1e3 * sigma).tolist()
    largest = float(1e3 * np.abs(values @ modes).max())
    shape = BentTarget((columns, rows), (sigma_columns, sigma_rows), largest, twist, sigma_twist)
    return Shaped(solution, solution.value("T_camera_target"), shape, 0)


def _priors(flat: Flat) -> list[Factor]:
    return [f for f in flat.solution.problem.factors if f.name != "reprojection"]


class PointReprojection(Factor):
    """Reprojection of target points that are unknowns themselves; an edge is one point in one view."""

    def __init__(self, *, model: CameraModel, views: StackedViews, points: Indices) -> None:
        self.model, self.uv = model, views.uv
        n = len(views.offsets) - 1
        edge = np.repeat(np.arange(n), np.diff(views.offsets))
        super().__init__(
            "reprojection",
            variables=("T_camera_target", "camera", POINTS),
            indices=(edge, np.zeros(len(edge), dtype=np.int64), points),
            dim=2,
            noise="pixel",
            relative_sigma=views.sigma,
            whitening=views.whitening,
        )

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        T, parameters, points = values
        rotated = (T[:, :3, :3] @ points[:, :, None])[..., 0]
        uv, J_point, J_camera = self.model.project_with_jacobians(parameters[0], rotated + T[:, :3, 3])
        J_pose = np.concatenate([-J_point @ so3.hat(rotated), J_point], axis=-1)
        return uv - self.uv, (J_pose, J_camera, J_point @ T[:, :3, :3])

    def residuals(self, *values: Array) -> Array:
        T, parameters, points = values
        return self.model.project(parameters[0], se3.apply(T, points)) - self.uv


def free_points(flat: Flat) -> Shaped:
    """Every point of the target; those seen fewer than three times stay out, for they say nothing but themselves."""
    ids = np.concatenate([v.point_ids for v in flat.views])
    labels, first, index, counts = np.unique(ids, return_index=True, return_inverse=True, return_counts=True)
    if counts.min() < 3:
        raise RefusedError(
            f"target point {labels[np.argmin(counts)]} is seen in {counts.min()} views, its own position needs 3 or "
            "more; take more views, or choose --target-shape paraboloid"
        )
    nominal = flat.stacked.points[first]
    spread = float(np.abs(flat.stacked.points - nominal[index]).max())
    if spread > 1e-9:
        raise InputError("a target with free points needs the same point ids for the same points in every view")
    poses, camera, _ = _variables(flat)
    points = Variable(POINTS, Euclidean(("x", "y", "z")), nominal, labels=[str(i) for i in labels])
    factor = PointReprojection(model=flat.model, views=flat.stacked, points=index.astype(np.int64))
    solution = solve(Problem((poses, camera, points), (factor, *_gauge(nominal), *_priors(flat))))
    if solution.unobservable:
        raise RefusedError(f"the target's points are not determined: {solution.unobservable[0].message}")
    found = solution.value(POINTS)
    scale, T_found_nominal = _best_similarity(nominal, found)
    aligned = se3.apply(se3.inverse(T_found_nominal), found) / scale
    T = solution.value("T_camera_target") @ T_found_nominal
    T[:, :3, 3] /= scale
    deviation = 1e3 * (aligned - nominal)
    sigma = 1e3 * np.sqrt(np.mean([np.trace(C) / 3 for C in solution.covariances(POINTS)]))
    normal = planar_start.in_plane(nominal).T_plane_target[2, :3]
    out = deviation @ normal
    shape = FreeTarget(
        points=len(labels),
        out_of_plane_rms_mm=float(np.sqrt(np.mean(out**2))),
        in_plane_rms_mm=float(np.sqrt(np.mean(np.sum((deviation - out[:, None] * normal) ** 2, axis=1) / 2))),
        largest_mm=float(np.linalg.norm(deviation, axis=1).max()),
        typical_sigma_mm=float(sigma),
        deviation_mm={str(i): (x, y, z) for i, (x, y, z) in zip(labels, deviation.tolist())},
    )
    return Shaped(solution, T, shape, GAUGE_EQUATIONS)


def _gauge(nominal: Array) -> list[Factor]:
    """Two far points held, and the third's distance from the plane that the board turns out of about their line."""
    a = int(np.argmax(np.linalg.norm(nominal - nominal.mean(axis=0), axis=1)))
    b = int(np.argmax(np.linalg.norm(nominal - nominal[a], axis=1)))
    axis = (nominal[b] - nominal[a]) / np.linalg.norm(nominal[b] - nominal[a])
    off = np.cross(nominal - nominal[a], axis)
    c = int(np.argmax(np.linalg.norm(off, axis=1)))
    normal = off[c] / np.linalg.norm(off[c])
    hold = np.eye(3) / GAUGE_SIGMA_M
    return [
        VectorPrior("first held point", POINTS, a, nominal[a], sqrt_information=hold),
        VectorPrior("second held point", POINTS, b, nominal[b], sqrt_information=hold),
        VectorPrior("third held point", POINTS, c, nominal[c], sqrt_information=normal[None] / GAUGE_SIGMA_M),
    ]


def _best_similarity(source: Array, target: Array) -> tuple[float, Array]:
    """s and T with s (R source + t) closest to target (Umeyama 1991): target ~ T applied to s * source."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    R = so3.nearest(b.T @ a)
    scale = float(np.sum(b * (a @ R.T)) / np.sum(a * a))
    return scale, se3.make(R, target.mean(axis=0) - scale * R @ source.mean(axis=0))


SHAPES: dict[str, Callable[[Flat], Shaped]] = {"paraboloid": paraboloid, "free": free_points}
TARGET_SHAPES: Sequence[str] = (FLAT, *SHAPES)
