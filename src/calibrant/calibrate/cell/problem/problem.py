"""The joint weighted refinement of several cameras and robots, as one problem.

    min sum_lists sum |project(theta_c, chain p_j) - uv|^2 / sigma_c^2
      + sum_robots sum |log(R_i R_i,said^T)|^2 / sigma_rot,r^2 + |t_i - t_i,said|^2 / sigma_trans,r^2

Pixels have a noise level a camera, poses two a robot. A pose that two cameras saw is one unknown, so its error is the
same for both. What a robot "said" is what its controller reports, or its geometry at the joints that were read
(`joint_offsets`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrant.calibrate.cell.consistency import CHI2_6_LIMIT, CHI2_6_MEDIAN, ROUNDING
from calibrant.calibrate.cell.problem.camera_role import (
    FLOORS,
    PIXEL,
    ROBOT_ROTATION,
    ROBOT_TRANSLATION,
    SCALE,
    CameraRole,
)
from calibrant.calibrate.cell.problem.joint_offsets import FreeJoints
from calibrant.calibrate.cell.problem.layout import Frame, Layout, poses_variable, variable
from calibrant.calibrate.cell.views import HandEyeViews
from calibrant.calibrate.reprojection.factor import ReprojectionFactor, TargetModes, stack
from calibrant.calibrate.reprojection.links import link_maps, product
from calibrant.cameras import Camera
from calibrant.data import View
from calibrant.geometry import se3
from calibrant.optimize.factors import Factor, RotationPrior, TranslationPrior, VectorPrior
from calibrant.optimize.manifolds import SE3, Euclidean, Variable
from calibrant.optimize.problem import Problem
from calibrant.optimize.solution import Solution

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

JOINTS = "joints"


@dataclass(frozen=True, eq=False)
class Several:
    """Everything the problem is made of: the layout, the matched views of each list of pictures, the cameras' roles,
    and the robots whose joints are free."""

    layout: Layout
    data: tuple[HandEyeViews, ...]
    roles: Mapping[str, CameraRole]
    free: Mapping[str, FreeJoints]

    def used_views(self, i: int) -> list[View]:
        """The views of list i that count."""
        data = self.data[i]
        return [v for v, use in zip(data.views or (), data.use) if use]

    def used_ids(self, i: int) -> list[str]:
        """The pose ids of these views."""
        return [name for name, use in zip(self.data[i].ids, self.data[i].use) if use]

    def moments(self, robot: str) -> tuple[str, ...]:
        """Poses of a robot that any picture needs, in the robot's order."""
        needed = {name for i, p in enumerate(self.layout.pictures) if robot in p.movers for name in self.used_ids(i)}
        return tuple(name for name in self.layout.robots[robot].ids if name in needed)

    def kept(self, keep: Sequence[Mask]) -> Several:
        """The same with fewer views; keep: one mask a list, over all its rows."""
        data = tuple(replace(d, use=d.use & k) for d, k in zip(self.data, keep))
        return replace(self, data=data)

    def seen_by(self, cameras: Mapping[str, Camera]) -> Several:
        """The same with the target poses of the used views found again by the cameras as refined."""
        pairs = zip(self.layout.pictures, self.data)
        return replace(self, data=tuple(d.seen_by(cameras[p.camera]) if d.use.any() else d for p, d in pairs))


def pixel_group(camera: str) -> str:
    """Noise group of a camera's pixels."""
    return f"{PIXEL} {camera}"


def robot_groups(robot: str) -> tuple[str, str]:
    """Noise groups of a robot's rotations and translations."""
    return f"{ROBOT_ROTATION} {robot}", f"{ROBOT_TRANSLATION} {robot}"


def joint_group(robot: str) -> str:
    """Noise group of a robot's joints, where its readings are given."""
    return f"{JOINTS} {robot}"


def lens_variable(camera: str) -> str:
    """Name of a camera's intrinsics."""
    return f"lens of {camera}"


def geometry_variable(robot: str) -> str:
    """Name of a robot's free joint offsets and geometry."""
    return f"geometry of {robot}"


def errors_variable(robot: str) -> str:
    """Name of what a robot's joints did beyond their readings and its geometry."""
    return f"joint errors of {robot}"


def scale_variable(target: str) -> str:
    """Name of a target's scale, less 1."""
    return f"{SCALE} {target}"


def pictures_factor(i: int) -> str:
    """Name of the reprojection factor of list i."""
    return f"pictures {i}"


def floors(several: Several) -> dict[str, float]:
    """Least noise of every group: pixels, radians, metres."""
    out = {pixel_group(c): FLOORS[PIXEL] for c in several.layout.cameras}
    for robot in several.layout.robots:
        out |= dict(zip(robot_groups(robot), (FLOORS[ROBOT_ROTATION], FLOORS[ROBOT_TRANSLATION])))
    return out | {joint_group(robot): FLOORS[ROBOT_ROTATION] for robot in several.free}


def several_problem(
    several: Several, transforms: Mapping[Frame, Array], sigmas: Mapping[str, float], *, free_scale: bool = False
) -> Problem:
    """The problem over all views that are used, started at these transforms; `free_scale`: with the targets' sizes."""
    layout = several.layout
    variables = [Variable(variable(f), SE3(), T[None], words=f"the place of {f[1]}") for f, T in transforms.items()]
    factors: list[Factor] = []
    lenses: dict[str, CameraRole] = {}
    for i, p in enumerate(layout.pictures):
        views = several.used_views(i)
        if not views:
            continue
        ids = several.used_ids(i)
        rows = {robot: _places(several.moments(robot), ids) for robot in p.movers}
        role = lenses[p.camera] = several.roles[p.camera]
        stacked, scale = stack(views), scale_variable(p.target)
        if free_scale and all(v.name != scale for v in variables):
            variables.append(Variable(scale, Euclidean(("scale",)), np.zeros((1, 1))))
        factors.append(
            ReprojectionFactor(
                pictures_factor(i),
                model=role.camera.model,
                camera=lens_variable(p.camera),
                links=layout.chain(p, rows, len(ids)),
                views=stacked,
                # The mode's amplitude is scale - 1: points + (s - 1) points.
                modes=TargetModes(scale, stacked.points[None]) if free_scale else None,
                noise=pixel_group(p.camera),
            )
        )
    for name, role in lenses.items():
        manifold = Euclidean(role.camera.model.parameter_names, role.held)
        lens = lens_variable(name)
        variables.append(Variable(lens, manifold, role.camera.values[None], words=f"the lens of {name}"))
        if role.prior is not None:
            mean, root = role.camera.values, role.prior
            factors.append(VectorPrior(f"prior of {name}", lens, 0, mean, sqrt_information=root))
    for robot in layout.robots:
        _add_robot(several, robot, variables, factors)
    needed = {name for f in factors for name in f.variables}
    return Problem(tuple(v for v in variables if v.name in needed), tuple(factors), dict(sigmas))


def _add_robot(several: Several, robot: str, variables: list[Variable], factors: list[Factor]) -> None:
    moments = several.moments(robot)
    if not moments:
        return
    said = several.layout.robots[robot].only(moments).T_base_gripper
    name, (rotation, translation) = poses_variable(robot), robot_groups(robot)
    variables.append(Variable(name, SE3(), said, labels=moments, words="the pose of"))
    free = several.free.get(robot)
    if free is None:
        factors += [
            RotationPrior(rotation, name, said, noise=rotation),
            TranslationPrior(translation, name, said, noise=translation),
        ]
        return
    rows = [free.readings.ids.index(m) for m in moments]
    geometry, errors = geometry_variable(robot), errors_variable(robot)
    variables += [free.variable(geometry), free.errors_variable(errors, rows)]
    factors += free.factors(name, geometry, errors, rows, noise=(rotation, translation, joint_group(robot)))


def fitted_cameras(several: Several, solution: Solution) -> dict[str, Camera]:
    """The cameras as refined; those without a picture left, as they were."""
    there = {v.name for v in solution.problem.variables}
    out = {}
    for name in several.layout.cameras:
        role = several.roles[name]
        if lens_variable(name) not in there:
            out[name] = role.camera
            continue
        exact = role.prior is None and len(role.held) == len(role.camera.values)
        covariance = None if exact else solution.covariance(lens_variable(name))
        values = solution.value(lens_variable(name))[0]
        out[name] = Camera(role.camera.model, role.camera.image_size, values, covariance)
    return out


def fitted_transforms(several: Several, solution: Solution) -> dict[Frame, Array]:
    """The unknown transforms as refined."""
    return {f: solution.value(variable(f))[0] for f in several.layout.unknown}


def said_poses(several: Several, solution: Solution, robot: str) -> Array:
    """T_base_gripper (n, 4, 4) of all a robot's poses: as reported, or by its geometry as fitted."""
    free = several.free.get(robot)
    if free is None:
        return several.layout.robots[robot].T_base_gripper
    model = free.at(solution, geometry_variable(robot))
    rows = [free.readings.ids.index(m) for m in several.layout.robots[robot].ids]
    return model.predict(free.readings.q[rows])


def pose_noise(several: Several, solution: Solution, robot: str) -> Array:
    """Covariance (n, 6, 6) of what all of a robot's poses are off by, in `se3.retract`'s chart: the poses' own noise,
    and what their joints' noise makes of them."""
    levels = solution.sigmas
    rotation, translation = (levels[g] for g in robot_groups(robot))
    C = np.diag([rotation**2] * 3 + [translation**2] * 3)
    ids = several.layout.robots[robot].ids
    free = several.free.get(robot)
    if free is None:
        return np.broadcast_to(C, (len(ids), 6, 6))
    rows = [free.readings.ids.index(m) for m in ids]
    J = free.at(solution, geometry_variable(robot)).joint_jacobian(free.readings.q[rows])
    return np.asarray(C + levels[joint_group(robot)] ** 2 * J @ np.swapaxes(J, -1, -2))


def _places(names: Sequence[str], wanted: Sequence[str]) -> NDArray[np.int64]:
    index = {name: k for k, name in enumerate(names)}
    return np.array([index[name] for name in wanted], dtype=np.int64)


def pose_rows(several: Several, i: int, rows: Mask) -> dict[str, NDArray[np.int64]]:
    """Which poses of each robot between camera and target the rows of list i were taken at."""
    ids = [name for name, r in zip(several.data[i].ids, rows) if r]
    layout = several.layout
    return {robot: _places(layout.robots[robot].ids, ids) for robot in layout.pictures[i].movers}


def prediction(several: Several, solution: Solution, i: int, rows: Mask) -> tuple[Array, dict[str, Array]]:
    """T_camera_target (m, 4, 4) of the rows of list i by what the robots said, and by robot the map from its poses'
    errors."""
    layout, p = several.layout, several.layout.pictures[i]
    at = pose_rows(several, i, rows)
    chain = layout.chain(p, at, int(rows.sum()))
    arms = {poses_variable(robot): robot for robot in p.movers}
    values = [
        said_poses(several, solution, arms[k.variable])[k.indices]
        if k.variable in arms
        else solution.value(k.variable)[k.indices]
        for k in chain
    ]
    maps = {arms[k.variable]: m for k, m in zip(chain, link_maps(chain, values)) if k.variable in arms}
    return product(chain, values), maps


def inconsistent(several: Several, solution: Solution, i: int) -> Mask:
    """True for each row of list i that is used and disagrees with the others beyond its noise; see `consistency`."""
    data, p = several.data[i], several.layout.pictures[i]
    out = np.zeros(len(data), dtype=bool)
    if not data.use.any():
        return out
    T, maps = prediction(several, solution, i, data.use)
    d = se3.local(T, data.B[data.use])
    C = data.covariance[data.use] * solution.sigmas[pixel_group(p.camera)] ** 2
    at = pose_rows(several, i, data.use)
    for robot, M in maps.items():
        C = C + M @ pose_noise(several, solution, robot)[at[robot]] @ np.swapaxes(M, -1, -2)
    statistic = np.einsum("ni,ni->n", d, np.linalg.solve(C, d[..., None])[..., 0])
    scale = max(float(np.median(statistic)) / CHI2_6_MEDIAN, 1.0)
    out[np.flatnonzero(data.use)] = (statistic / scale > CHI2_6_LIMIT) & (np.sum(d * d, axis=1) > ROUNDING)
    return out
