"""The weighted refinement of a cell, as one problem.

    min sum_lists sum |project(theta_c, T_camera_target p_j) - uv|^2 / sigma_c^2
      + sum_robots sum |log(R_i R_i,said^T)|^2 / sigma_rot,r^2 + |t_i - t_i,said|^2 / sigma_trans,r^2

over all transforms, the robots' true poses and the lenses. Pixels have a noise level a camera, poses two a robot. A
pose that two cameras saw is one unknown, so its error is the same for both. What a robot "said" is what its controller
reports, or its geometry at the joints that were read (`joint_offsets`). Lists of measured target poses have the terms
of `pose_pairs` in place of pixels. Assuming a robot exact (no correction) is worse than a closed form as soon as its
noise outweighs the pixels'; the noise levels that decide this are estimated with the rest (`optimize.noise`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Mask
from calibrant.calibrate.cell.problem.camera_role import CameraRole
from calibrant.calibrate.cell.problem.clocks import Clocks, Times
from calibrant.calibrate.cell.problem.groups import (
    JOINTS,
    PAIR_FLOORS,
    PHOTO_FLOORS,
    PIXEL,
    ROBOT_ROTATION,
    ROBOT_TRANSLATION,
    TARGET_ROTATION,
    TARGET_TRANSLATION,
    TOUCH_FLOOR,
    errors_variable,
    extra_variable,
    geometry_variable,
    joint_group,
    lens_variable,
    measured_groups,
    pictures_factor,
    pixel_group,
    robot_groups,
    scale_variable,
)
from calibrant.calibrate.cell.problem.joint_offsets import FreeJoints
from calibrant.calibrate.cell.problem.layout import (
    ONLY_ROBOT,
    Frame,
    Layout,
    Pictures,
    TargetPoses,
    poses_variable,
    variable,
)
from calibrant.calibrate.cell.problem.pose_pairs import MeasuredRotation, MeasuredTranslation
from calibrant.calibrate.cell.problem.same_focal import with_one_focal
from calibrant.calibrate.cell.problem.touches import TouchFactor, touch_group, touch_name
from calibrant.calibrate.cell.problem.views import HandEyeViews, from_target_poses
from calibrant.calibrate.reprojection.carried import CarriedFactor
from calibrant.calibrate.reprojection.factor import ReprojectionFactor, StackedViews, TargetModes, stack
from calibrant.calibrate.reprojection.links import Link
from calibrant.calibrate.solvers.setup import Setup
from calibrant.data import DEFAULT_CAMERA, Observations, RobotPoses, View
from calibrant.data.observations import Carried
from calibrant.optimize.factors import Factor, RotationPrior, TranslationPrior, VectorPrior
from calibrant.optimize.manifolds import SE3, Euclidean, Position, Variable
from calibrant.optimize.noise import NoiseLevel
from calibrant.optimize.problem import Problem

Rows = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Cell:
    """Everything the problem is made of: the layout, the matched views of each list of pictures, the roles of the
    cameras that have images, the robots whose joints are free, the times of
    moments, seconds, where they are known, and the clocks of the cameras where they are asked for. same_focal: two
    cameras with one focal length, or none."""

    layout: Layout
    data: tuple[HandEyeViews, ...]
    roles: Mapping[str, CameraRole]
    free: Mapping[str, FreeJoints]
    times: Times = field(default_factory=Times)
    clocks: Clocks | None = None
    same_focal: tuple[()] | tuple[str, str] = ()

    @property
    def lists(self) -> list[tuple[int, Pictures, HandEyeViews]]:
        """Every list of pictures with its number and its matched views."""
        return [(i, p, d) for i, (p, d) in enumerate(zip(self.layout.pictures, self.data))]

    def placed(self, *T: Array) -> dict[Frame, Array]:
        """Transforms (4, 4) by their frames, in the order of the layout's unknowns: cameras, targets, other bases."""
        return dict(zip(self.layout.unknown, T, strict=True))

    def used_views(self, i: int) -> list[View]:
        """The views of list i that count."""
        data = self.data[i]
        return [v for v, use in zip(data.views or (), data.use) if use]

    def used_ids(self, i: int) -> list[str]:
        """The pose ids of the rows of list i that count."""
        return [name for name, use in zip(self.data[i].ids, self.data[i].use) if use]

    def moments(self, robot: str) -> tuple[str, ...]:
        """Poses of a robot that any picture needs, in the robot's order."""
        needed = {name for i, p in enumerate(self.layout.pictures) if robot in p.movers for name in self.used_ids(i)}
        return tuple(name for name in self.layout.robots[robot].ids if name in needed)

    def moments_by_hand(self, carrier: str) -> tuple[str, ...]:
        """Moments of a handheld target, by its frame (`moments_by_hand`)."""
        if carrier not in self._by_hand:
            self._by_hand[carrier] = moments_by_hand(self.layout, self.data, carrier)
        return self._by_hand[carrier]

    @cached_property
    def _by_hand(self) -> dict[str, tuple[str, ...]]:
        return {}

    def rows(self, i: int) -> dict[str, Rows]:
        """At which of its moments list i's used views saw each robot between camera and target, by the robot's name;
        or the carrier of a handheld target, by its frame."""
        p, ids = self.layout.pictures[i], self.used_ids(i)
        if p.handheld:
            carrier = self.layout.carrier(p)
            return {carrier: places(self.moments_by_hand(carrier), ids)}
        return {robot: places(self.moments(robot), ids) for robot in p.movers}

    def kept(self, keep: Sequence[Mask]) -> Cell:
        """The same with fewer views; keep: one mask a list, over all its rows."""
        data = tuple(replace(d, use=d.use & k) for d, k in zip(self.data, keep))
        return replace(self, data=data)

    def pixel_group(self, camera: str) -> str:
        """Noise group of a camera's pixels. Cameras that see handheld targets share one: what the clocks, the target's
        shape or a camera that gave way err by is in all of them, and a level each would lay it on the one that fits
        worst. What another camera's corners carried errs as its decoding does, by itself."""
        return PIXEL if self.alike(camera) else pixel_group(camera)

    def alike(self, camera: str) -> bool:
        """Whether a camera has its noise with others, that see handheld targets as it does."""
        return camera in self._alike

    @cached_property
    def _alike(self) -> frozenset[str]:
        lists = [(p.camera, p.seen.views) for p in self.layout.pictures if p.seen is not None]
        carried = {camera for camera, views in lists if any(v.carried is not None for v in views)}
        return frozenset(c for group in self.layout.by_hand for c in group if c not in carried)

    @cached_property
    def pixel_ratios(self) -> Mapping[str, float]:
        """By camera, its pixel noise over its group's level: by the cameras' own calibrations."""
        own = {c: self.own_sigma_px(c) for c in self.roles if self.alike(c)}
        typical = float(np.exp(np.mean(np.log(list(own.values()))))) if own else 1.0
        return dict.fromkeys(self.roles, 1.0) | {c: s / typical for c, s in own.items()}

    def own_sigma_px(self, camera: str) -> float:
        """Pixel noise of a camera by its own calibration."""
        own = max(d.sigma_px for p, d in zip(self.layout.pictures, self.data) if p.camera == camera)
        return max(own, PHOTO_FLOORS[PIXEL])

    def pixel_level(self, levels: Mapping[str, NoiseLevel], camera: str) -> NoiseLevel:
        """A camera's pixel noise."""
        level, ratio = levels[self.pixel_group(camera)], self.pixel_ratios[camera]
        return level if ratio == 1 else replace(level, sigma=ratio * level.sigma, deviation=ratio * level.deviation)

    @cached_property
    def robots_in_images(self) -> frozenset[str]:
        """Robots that stand between a camera and a target in any image."""
        return frozenset(r for p in self.layout.pictures if p.seen is not None for r in p.movers)

    def measured_noise(self, p: Pictures) -> tuple[str, str]:
        """Noise groups of measured target poses; their positions share the robot's, where no image tells it."""
        rotation, translation = measured_groups(p.camera)
        return rotation, translation if p.robot in self.robots_in_images else robot_groups(p.robot)[1]

    def floors(self) -> dict[str, float]:
        """Least noise of every group: pixels, radians, metres."""
        out = {self.pixel_group(c): PHOTO_FLOORS[PIXEL] for c in self.roles}
        for p in self.layout.pictures:
            if p.seen is None:
                levels = (PAIR_FLOORS[TARGET_ROTATION], PAIR_FLOORS[TARGET_TRANSLATION])
                out |= dict(zip(measured_groups(p.camera), levels))
        for robot in self.layout.robots:
            least = PHOTO_FLOORS if robot in self.robots_in_images else PAIR_FLOORS
            out |= dict(zip(robot_groups(robot), (least[ROBOT_ROTATION], least[ROBOT_TRANSLATION])))
        out |= {touch_group(t.tool): TOUCH_FLOOR for t in self.layout.touches}
        return out | {joint_group(robot): PHOTO_FLOORS[JOINTS] for robot in self.free}

    def levels(self, spread: tuple[float, float]) -> dict[str, float]:
        """Noise levels to start from, of what a loop errs by typically, radians and metres."""
        rotation, translation = spread
        out: dict[str, float] = {}
        for robot in self.layout.robots:
            # Measured target poses and the robot share one level of position; images leave half of it to the robot.
            own = translation / 2 if robot in self.robots_in_images else translation
            out |= dict(zip(robot_groups(robot), (rotation / 2, own)))
        for p, d in zip(self.layout.pictures, self.data):
            out |= (
                dict(zip(self.measured_noise(p), (rotation, translation)))
                if p.seen is None
                else {self.pixel_group(p.camera): d.sigma_px / self.pixel_ratios[p.camera]}
            )
        out |= {touch_group(t.tool): translation for t in self.layout.touches}
        # A joint turns the pose as the pose's own noise does.
        return out | {joint_group(robot): rotation / 2 for robot in self.free}


def cell_problem(
    cell: Cell, transforms: Mapping[Frame, Array], sigmas: Mapping[str, float], *, free_sizes: Collection[str] = ()
) -> Problem:
    """The problem over all views that are used, started at these transforms; those of handheld targets (m, 4, 4), by
    moment.

    free_sizes: names of the targets whose scale is unknown.
    """
    variables = [_place(cell, f, T) for f, T in transforms.items()]
    variables += [Variable(scale_variable(t), Euclidean(("scale",)), np.zeros((1, 1))) for t in free_sizes]
    factors: list[Factor] = []
    for i in range(len(cell.data)):
        factors += _list_factors(cell, i, scale=cell.layout.pictures[i].target in free_sizes)
    factors += [_touch_factor(cell, k, scale=t.target in free_sizes) for k, t in enumerate(cell.layout.touches)]
    seen = {name for f in factors for name in f.variables}
    if cell.clocks is not None:
        clocks = (cell.clocks.variable(name) for name in cell.clocks.terms)
        variables += [v for v in clocks if v.name in seen]
    for name, role in cell.roles.items():
        if lens_variable(name) in seen:
            _add_lens(cell, name, role, variables, factors)
    if cell.same_focal and {lens_variable(name) for name in cell.same_focal} <= seen:
        _tie_focal(cell, *cell.same_focal, variables)
    for robot in cell.layout.robots:
        _add_robot(cell, robot, variables, factors)
    needed = {name for f in factors for name in f.variables}
    return Problem(tuple(v for v in variables if v.name in needed), tuple(factors), dict(sigmas))


def _place(cell: Cell, frame: Frame, T: Array) -> Variable:
    if frame in cell.layout.handheld:
        labels = cell.moments_by_hand(frame[1])
        return Variable(variable(frame), SE3(), T, labels=labels, words=f"{frame[1]} at")
    kind = Position() if frame in cell.layout.positions else SE3()
    return Variable(variable(frame), kind, T[None], words=f"the place of {frame[1]}")


def _touch_factor(cell: Cell, k: int, *, scale: bool) -> TouchFactor:
    layout, t = cell.layout, cell.layout.touches[k]
    base = layout.base(t.robot)
    return TouchFactor(
        touch_name(k),
        layout.robots[t.robot].only(t.ids).T_base_gripper,
        t.places,
        tip=variable(layout.tip(t)),
        touched=variable(layout.touched(t)),
        noise=touch_group(t.tool),
        base=None if base == layout.root else variable((layout.root, base)),
        scale=scale_variable(t.target) if scale else None,
    )


def _list_factors(cell: Cell, i: int, *, scale: bool) -> list[Factor]:
    """What list i says: its pixels, or its measured target poses."""
    p, data = cell.layout.pictures[i], cell.data[i]
    ids = cell.used_ids(i)
    if not ids:
        return []
    links = cell.layout.links(p, cell.rows(i), len(ids))
    size = scale_variable(p.target) if scale else None
    if p.seen is None:
        B, (rotation, translation) = data.B[data.use], cell.measured_noise(p)
        return [
            MeasuredRotation(f"rotations {i}", links, B, noise=rotation),
            MeasuredTranslation(f"translations {i}", links, B, noise=translation, scale=size),
        ]
    stacked = stack(cell.used_views(i)).noisier(cell.pixel_ratios[p.camera])
    # The mode's amplitude is scale - 1: points + (s - 1) points.
    modes = None if size is None else TargetModes(size, stacked.points[None])
    if cell.clocks is not None and cell.clocks.displaces(p.camera):
        height = cell.roles[p.camera].camera.image_size[1]
        frames = p.camera, cell.layout.carrier(p), cell.layout.target(p)
        stacked, modes = cell.clocks.displaced(*frames, ids, stacked, height)
    seen = _reprojection(cell, p, links, stacked, name=pictures_factor(i), modes=modes)
    carried = [v.carried for v in cell.used_views(i) if v.carried is not None]
    return [seen] if len(carried) < len(ids) else [_carried(cell, i, seen, carried)]


def _reprojection(
    cell: Cell, p: Pictures, links: Sequence[Link], views: StackedViews, *, name: str, modes: TargetModes | None = None
) -> ReprojectionFactor:
    return ReprojectionFactor(
        name,
        model=cell.roles[p.camera].camera.model,
        camera=lens_variable(p.camera),
        links=links,
        views=views,
        modes=modes,
        noise=cell.pixel_group(p.camera),
    )


def _carried(cell: Cell, i: int, seen: ReprojectionFactor, carried: Sequence[Carried]) -> Factor:
    """The factor of list i, whose points another camera's carried; as if they were its own where that is not there."""
    p, n = cell.layout.pictures[i], len(carried)
    other = next((q for q in cell.layout.pictures if q.camera == carried[0].camera and q.target == p.target), None)
    if other is None or {c.camera for c in carried} != {other.camera} or other.camera not in cell.roles:
        return seen
    links = cell.layout.links(replace(p, camera=other.camera), cell.rows(i), n)
    views = replace(seen.views, uv=np.concatenate([c.uv for c in carried]))
    at = _reprojection(cell, other, links, views, name=f"{other.camera} of {seen.name}", modes=seen.modes)
    return CarriedFactor(seen.name, seen=seen, at=at, slope=np.concatenate([c.slope for c in carried]))


def _add_lens(cell: Cell, name: str, role: CameraRole, variables: list[Variable], factors: list[Factor]) -> None:
    lens, values = lens_variable(name), role.camera.values
    variables.append(Variable(lens, role.manifold, values[None], words=f"the lens of {name}"))
    if role.prior is not None:
        factors.append(VectorPrior(f"prior of {name}", lens, 0, values, sqrt_information=role.prior))
    if role.weak is not None and len(role.weak):
        nothing = np.zeros_like(values)
        factors.append(VectorPrior(f"weak terms of {name}", lens, 0, nothing, sqrt_information=role.weak))
    if role.extra:
        apart = extra_variable(name)
        variables.append(Variable(apart, SE3(), role.extra_poses))
        factors.append(
            ReprojectionFactor(
                apart,
                model=role.camera.model,
                camera=lens,
                links=[Link(apart, np.arange(len(role.extra)))],
                views=stack(role.extra).noisier(cell.pixel_ratios[name]),
                noise=cell.pixel_group(name),
            )
        )


def _tie_focal(cell: Cell, a: str, b: str, variables: list[Variable]) -> None:
    """One focal length for two cameras that are said to have the same."""
    i, j = ([v.name for v in variables].index(lens_variable(name)) for name in (a, b))
    variables[i], variables[j] = with_one_focal(variables[i], variables[j], cell.roles[a], cell.roles[b])


def _add_robot(cell: Cell, robot: str, variables: list[Variable], factors: list[Factor]) -> None:
    moments = cell.moments(robot)
    if not moments:
        return
    said = cell.layout.robots[robot].only(moments).T_base_gripper
    name, (rotation, translation) = poses_variable(robot), robot_groups(robot)
    variables.append(Variable(name, SE3(), said, labels=moments, words="the pose of"))
    free = cell.free.get(robot)
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


def moments_by_hand(layout: Layout, data: Sequence[HandEyeViews], carrier: str) -> tuple[str, ...]:
    """Moments at which a handheld target, by its frame, or one that it carries was seen in any view that is used."""
    lists = [d for p, d in zip(layout.pictures, data) if p.handheld and layout.carrier(p) == carrier]
    return tuple(dict.fromkeys(name for d in lists for name, use in zip(d.ids, d.use) if use))


def places(names: Sequence[str], wanted: Sequence[str]) -> Rows:
    """Positions of the wanted names."""
    index = {name: k for k, name in enumerate(names)}
    return np.array([index[name] for name in wanted], dtype=np.int64)


def cell_of_one(
    setup: Setup, T_base_gripper: Array, target: Sequence[View] | Array, role: CameraRole | None = None
) -> Cell:
    """A cell of one list, row by row: robot poses (n, 4, 4) with T_camera_target (n, 4, 4), or with views of a camera.

    The frames are those of the setup. The target poses of views are not looked at: they stand as the identity.
    """
    poses = RobotPoses.from_matrices(T_base_gripper)
    if role is None:
        measured = TargetPoses(poses.ids, np.asarray(target))
        data = from_target_poses(poses, measured.T_camera_target)
        return Cell(Layout({ONLY_ROBOT: poses}, (Pictures(DEFAULT_CAMERA, setup.name, measured),)), (data,), {}, {})
    views = tuple(replace(v, id=i, moment=i, camera=DEFAULT_CAMERA) for v, i in zip(target, poses.ids))
    seen = Observations(views, {DEFAULT_CAMERA: role.camera.image_size})
    data = replace(from_target_poses(poses, np.tile(np.eye(4), (len(poses), 1, 1))), views=views)
    layout = Layout({ONLY_ROBOT: poses}, (Pictures(DEFAULT_CAMERA, setup.name, seen),))
    return Cell(layout, (data,), {DEFAULT_CAMERA: role}, {})
