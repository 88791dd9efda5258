"""What pictures of a target are off by, where a calibration says where the target should be.

    off_i = local(T_i predicted, T_i seen) = M_X dx + M_Z dz - D dtheta + M_A r_i + M_D d + e_i

M are the maps of the chain's links (`reprojection.links`), dx, dz and dtheta the errors of camera, target and lens with
their joint covariance, r_i of the robot's pose, d the camera's move (T_before_after, axes of the camera before) and D
what the lens moves a fitted pose by.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.pose.both_solutions import FEWEST_POINTS, ViewPose, view_poses
from calibrant.calibrate.reprojection.factor import stack
from calibrant.calibrate.reprojection.links import Link, link_maps, product
from calibrant.calibrate.tool.self_visibility import moved_by_camera
from calibrant.cameras import Camera
from calibrant.data import View
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.verification.unchanged.model import square_root
from calibrant.verification.unchanged.robot_noise import RobotSide
from calibrant.verification.watch.sequential import Sight

SAME_PLACE = (1e-4, 1e-4)
"""Metres and radians within which a robot stands where it stood: controllers repeat to about this."""
POSSIBLE = 1e-3
"""Chance of a second solution from which on it may be the pose: a flat tag's two are told apart by more, or not."""
UNKNOWN = (0.5, 1.0)
"""Radians and metres, 1 sigma, of a target that nothing is known of before the first picture."""


@dataclass(frozen=True, eq=False)
class PlacedView:
    """A picture's target: its view, T_camera_target (4, 4) and the covariance (6, 6) of its points' noise."""

    view: View
    T_camera_target: Array
    covariance: Array


def placed_views(
    camera: Camera, views: Sequence[View], expected: Array, *, stated_px: float | None = None
) -> tuple[PlacedView, ...]:
    """The target of every picture, of two solutions the one nearer to where it should be, (n, 4, 4).

    stated_px: the noise of a point at the calibration, that now is no smaller. Raises: InputError for a view with too
    few points.
    """
    few = next((v for v in views if len(v) < FEWEST_POINTS), None)
    if few is not None:
        raise InputError(f"picture {few.id!r} shows {len(few)} points of the target; {FEWEST_POINTS} are needed")
    lens = replace(camera, covariance=None)
    found = view_poses(lens, views)
    level = max(found.sigma_px, stated_px or 0.0)
    stacked = stack([p.view for p in found.views])
    sigmas = np.split(level * stacked.sigma, stacked.offsets[1:-1])
    out = []
    for pose, T, sigma in zip(found.views, expected, sigmas):
        nearest = _nearest(pose, T)
        out.append(PlacedView(pose.view, nearest, points_covariance(lens, pose.view, nearest, sigma)))
    return tuple(out)


def _nearest(pose: ViewPose, expected: Array) -> Array:
    best, other = pose.best, pose.other
    if other is None or other.probability < POSSIBLE:
        return best.T_camera_target
    turns = [float(np.linalg.norm(se3.local(expected, s.T_camera_target)[:3])) for s in (best, other)]
    return (best if turns[0] <= turns[1] else other).T_camera_target


def points_covariance(camera: Camera, view: View, T: Array, sigma: Array) -> Array:
    """Covariance (6, 6) of a pose by its points' noise sigma (n,), pixels."""
    rotated = view.points @ T[:3, :3].T
    _, J_point, _ = camera.model.project_with_jacobians(camera.values, rotated + T[:3, 3])
    J = np.concatenate([-J_point @ so3.hat(rotated), J_point], axis=-1) / sigma[:, None, None]
    H = np.einsum("nai,naj->ij", J, J)
    scale = 1 / np.sqrt(np.diag(H))
    return np.asarray(np.linalg.inv(H * scale[:, None] * scale) * scale[:, None] * scale)


def at_robot_poses(
    camera: Camera, side: RobotSide, placed: Sequence[PlacedView], T_base_gripper: Array
) -> tuple[Sight, ...]:
    """Sights of pictures taken at robot poses (n, 4, 4), in the order they were taken."""
    root = square_root(_whole(side))
    places = _places(T_base_gripper)
    turn, shift = side.rotation, side.translation
    own = np.repeat([turn, shift], 3) * np.sqrt(1 - side.alike)
    alike = (np.repeat([turn, shift], 3) * np.sqrt(side.alike)) ** 2
    if side.arm is not None:
        alike = alike + np.repeat([0.0, side.arm.metres**2], 3)
    n, once = len(placed), np.zeros(len(placed), dtype=np.int64)
    chain = [Link("moved", once, True), Link("X", once, True), Link("A", once, side.in_hand), Link("Z", once)]
    chain.append(Link("other", once))
    unmoved, X, Z = (np.broadcast_to(T, (n, 4, 4)) for T in (np.eye(4), side.X, side.Z))
    values = [unmoved, X, np.asarray(T_base_gripper), Z, unmoved]
    expected = product(chain, values)
    maps = [np.broadcast_to(M, (n, 6, 6)) for M in link_maps(chain, values)]
    sights = []
    for i, one in enumerate(placed):
        of_move, of_X, of_A, of_Z, of_other = (M[i] for M in maps)
        of_lens = -moved_by_camera(camera, one.view, one.T_camera_target)
        back = np.linalg.solve(of_move, of_A)
        sights.append(
            Sight(
                one.view.id,
                se3.local(expected[i], one.T_camera_target),
                np.concatenate([of_X, of_Z, of_lens], axis=1) @ root,
                of_A * own,
                places[i],
                of_move,
                one.covariance,
                (back * alike) @ back.T,
                of_other,
            )
        )
    return tuple(sights)


def with_target_at(side: RobotSide, T_target_parent: Array) -> RobotSide:
    """The side of a camera that watches another target than the calibration's, whose place (4, 4) is known roughly, as
    by the first picture: it is learnt from the pictures, and only a move among them is told."""
    C = side.covariance.copy()
    C[6:12] = C[:, 6:12] = 0.0
    C[6:12, 6:12] = np.diag(np.repeat(UNKNOWN, 3)) ** 2
    return replace(side, Z=T_target_parent, covariance=C, arm=None)


def _whole(side: RobotSide) -> Array:
    """The covariance of (X, Z, lens) with what the arm errs by in it."""
    C = side.covariance.copy()
    if side.arm is not None:
        moved, _ = side.arm.roots(side.arm.T_base_gripper[:0])
        C[:12, :12] += moved @ moved.T
    return C


def _places(T: Array) -> list[int]:
    """Numbers of places: the same while the robot stands still."""
    out, here = [0], T[0]
    for now in T[1:]:
        step = se3.local(here, now)
        still = np.linalg.norm(step[3:]) < SAME_PLACE[0] and np.linalg.norm(step[:3]) < SAME_PLACE[1]
        out.append(out[-1] if still else out[-1] + 1)
        here = here if still else now
    return out


def standing_still(
    placed: Sequence[PlacedView], T_camera_target: Array | None, covariance: Array | None = None
) -> tuple[Sight, ...]:
    """Sights of a camera and a target that both stand still, against the pose (4, 4) of then with its covariance, or,
    without one, against the first picture's."""
    if T_camera_target is None:
        T_camera_target, covariance = placed[0].T_camera_target, np.diag(np.repeat(UNKNOWN, 3)) ** 2
    root = square_root(np.zeros((6, 6)) if covariance is None else covariance)
    nothing = np.zeros((6, 0))
    # T_camera_target = D^-1 T_then: a camera that moves by d sees the target move the other way, about its own origin.
    arm = T_camera_target[:3, 3]
    of_move = np.block([[-np.eye(3), np.zeros((3, 3))], [so3.hat(arm), -np.eye(3)]])
    return tuple(
        Sight(
            one.view.id,
            se3.local(T_camera_target, one.T_camera_target),
            root,
            nothing,
            0,
            of_move,
            one.covariance,
        )
        for one in placed
    )


def shared_while_still(sight: Sight) -> Array:
    """Covariance (6, 6) of a camera's move that no number of pictures from one place lowers.

    Corners err by the same in every picture as long as nothing moves, and otherwise after a move: taken as large as one
    picture's noise. It hides no move, since it is constant before it; but it stays in how far that was.
    """
    back = np.linalg.inv(sight.of_move)
    return np.asarray(back @ sight.covariance @ back.T)
