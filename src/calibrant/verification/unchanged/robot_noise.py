"""The robot's side of a hand-eye result: camera and target with their covariance, and how far a new pose may be off.

The noise of a pose is what the calibration found, enlarged where its views are farther off than that noise and the
corners' together explain: by the e^2 (of the turns, then of the places) with which the residuals r_i of n views,
weighed by their own covariance S_i, are as large as they should be (Paule and Mandel 1982; camera and target take two
views'):

    sum r_i^T (S_i + e^2 I)^-1 r_i = 3 (n - 2)

Errors of a robot's geometry are smooth: photos taken near each other err alike. The correlation rho of neighbouring
views of the calibration (lag 1, one sigma above what was found) says how much of the variance new photos may share.

What the calibration holds of such errors in the covariance of camera and target (`cell.certainty.geometry`) says how
far these are from the truth, and the same arm errs by the same at the same place: with E the field at its poses and at
those of now, a g of it moves camera and target by M E_then g and the poses of now by E_now g,

    M = -(sum J^T S^-1 J)^-1 J^T S^-1 J_A,

which cancel where the arm works as it did and add up where it does not. They enter as one, and stand in the covariance
of camera and target no more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from calibrant.arrays import Array
from calibrant.calibrate.cell.certainty.accuracy import geometry_field
from calibrant.calibrate.cell.certainty.geometry import RADIANS, REACH
from calibrant.calibrate.cell.problem.layout import Pictures
from calibrant.calibrate.cell.stated import cell_layout
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.calibrate.reprojection.links import Link, link_maps, product
from calibrant.calibrate.reprojection.outliers import median
from calibrant.data import CalibrationResult, View
from calibrant.data.details import ArmErrors
from calibrant.diagnose.budget.cell import ErrorBudget, cell_budgets, inverse_information
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3
from calibrant.verification.unchanged.model import square_root

FEWEST = 4
"""Views below which neighbours say nothing of each other."""


@dataclass(frozen=True, eq=False)
class ArmField:
    """What an arm's geometry errs by, rms at the flange, metres; T (n, 4, 4) the calibration's poses, and pull
    (12, 6 n), M, by which their errors move camera and target."""

    metres: float
    T_base_gripper: Array
    pull: Array

    def roots(self, T_now: Array) -> tuple[Array, Array]:
        """Of what the arm errs by: the shares (12, k) of camera and target, and (m, 6, k) of poses T_now (m, 4, 4)."""
        n = len(self.T_base_gripper)
        every = np.concatenate([self.T_base_gripper, T_now])
        E = self.metres * geometry_field(every, reach=REACH, radians=RADIANS)
        return np.asarray(self.pull @ E[:n].reshape(6 * n, -1)), E[n:]


@dataclass(frozen=True, eq=False)
class RobotSide:
    """X and Z of A X B = Z with the covariance (12 + k, 12 + k) of (X, Z, lens), the noise of a robot pose (radians,
    metres, per axis), which part of its variance photos share, 0 to 1, how many views it was found from beyond the
    two that camera and target take, and what the arm errs by then and now, beside the covariance."""

    in_hand: bool
    X: Array
    Z: Array
    covariance: Array
    rotation: float
    translation: float
    alike: float
    freedom: float = 1.0
    arm: ArmField | None = None

    @property
    def X_inverse(self) -> Array:
        """The camera's parent in the camera."""
        return se3.inverse(self.X)

    def roots(self, photos: int) -> tuple[Array, Array]:
        """Square roots (6, 6) of a pose's own covariance and of the one it shares with the other photos."""
        sigma = np.repeat([self.rotation, self.translation], 3)
        alike = self.alike if photos > 1 else 0.0
        return np.diag(sigma * np.sqrt(1 - alike)), np.diag(sigma * np.sqrt(alike))

    def predicted(self, T_base_gripper: Array) -> Array:
        """T_camera_target (m, 4, 4) that robot poses (m, 4, 4) give."""
        A = se3.inverse(T_base_gripper) if self.in_hand else T_base_gripper
        return self.X_inverse @ A @ self.Z


def robot_side(result: CalibrationResult, camera: str) -> RobotSide:
    """The side of one camera of a hand-eye result on one robot.

    Raises: InputError for a result without the data it was made from, of several robots, of a camera that no robot
    moves and whose target none moves.
    """
    layout = cell_layout(result)
    if layout is None or result.robot_poses is None:
        raise InputError(
            "the result does not hold the photos' points and the robot's poses that it was made from; calibrate again "
            "from photos with this version, then verify against that result"
        )
    pictures = next((p for p in layout.pictures if p.camera == camera and p.seen is not None), None)
    if pictures is None or not pictures.movers:
        raise InputError(f"camera {camera!r} has no robot between itself and a target in this result; give --reference")
    if len(layout.robots) != 1:
        raise InputError(
            f"the result is of {len(layout.robots)} robots; `verify unchanged --poses` compares with one robot: give "
            "--reference, a photo of the calibration's day, instead"
        )
    try:
        budget = cell_budgets(result, target_sigma=0.0)[camera].budget
    except RefusedError as error:
        raise InputError(f"the result states no uncertainty to compare with: {error}") from error
    if budget.noise is None or budget.camera is None:
        raise InputError("the result was made from target poses, not photos: it holds no camera to compare photos with")
    said = layout.robots[pictures.robot]
    return _with_errors(result, budget, pictures, dict(zip(said.ids, said.T_base_gripper)))


def _with_errors(
    result: CalibrationResult, budget: ErrorBudget, pictures: Pictures, poses: dict[str, Array]
) -> RobotSide:
    """The side with the noise that the calibration's own views bear out."""
    in_hand = pictures.setup == "eye-in-hand"
    noise = budget.noise
    if noise is None or pictures.seen is None:
        raise InputError("the result holds no noise of its robot")
    C = budget.covariance
    side = RobotSide(in_hand, budget.X, budget.Z, C, noise.robot_rotation, noise.robot_translation, 0.0)
    used = {v.id for v in result.views if v.used}
    views = [v for v in pictures.seen.views if v.moment in poses and len(v) >= 4 and v.id in used]
    A = np.stack([poses[v.moment] for v in views])
    steps, of_all, of_pose, (of_places, own) = _loop(side, budget, views, A, noise.pixel)
    freedom = max(len(views) - 2.0, 1.0)
    turned = _extra(steps[:, :3], own[:, :3, :3], freedom)
    # A pose that is turned moves the target with it.
    lever = of_pose[:, 3:, :3]
    moved = _extra(steps[:, 3:], own[:, 3:, 3:] + turned * lever @ np.swapaxes(lever, -1, -2), freedom)
    rotation, translation = float(np.hypot(side.rotation, turned**0.5)), float(np.hypot(side.translation, moved**0.5))
    C, arm = _with_arm(result, pictures.robot, A, C, (of_places, own), of_pose)
    return RobotSide(in_hand, budget.X, budget.Z, C, rotation, translation, _alike(steps, of_all), freedom, arm)


def _extra(steps: Array, own: Array, freedom: float) -> float:
    """e^2 >= 0 beside covariances own (n, 3, 3) by which steps (n, 3) are as large as 3 `freedom` draws of a sigma."""
    values, axes = np.linalg.eigh(own)
    squares = np.square(np.einsum("nij,ni->nj", axes, steps))

    def beyond(extra: float) -> float:
        return float(np.sum(squares / (values + extra))) - 3 * freedom

    if beyond(0.0) <= 0:
        return 0.0
    return float(brentq(beyond, 0.0, float(squares.sum()) / freedom))


def _with_arm(
    result: CalibrationResult, robot: str, A: Array, C: Array, of_places: tuple[Array, Array], of_pose: Array
) -> tuple[Array, ArmField | None]:
    """The covariance without what the arm errs by, and that by itself. of_places: J (n, 6, 12), S (n, 6, 6)."""
    found = result.detail(ArmErrors)
    metres = 0.0 if found is None or robot not in found.robots else 1e-3 * found.robots[robot].held_mm
    if not metres:
        return C, None
    J, S = of_places
    weighed = np.linalg.solve(S, J)
    white = inverse_information(np.einsum("nai,naj->ij", J, weighed))
    pull = -white @ np.einsum("nai,nab->inb", weighed, of_pose).reshape(12, -1)
    arm = ArmField(metres, A, pull)
    moved, _ = arm.roots(A[:0])
    M = np.eye(len(C))
    M[:12, :12] = _less(C[:12, :12], moved @ moved.T, white)
    return M @ C @ M.T, arm


def _less(whole: Array, part: Array, least: Array) -> Array:
    """M with M whole M^T = whole - part, and no direction's variance below that of `least`, or above the whole's."""
    root = square_root(least)
    back = np.linalg.pinv(root)
    values, axes = np.linalg.eigh(back @ (whole - part) @ back.T)
    left = root @ (axes * np.maximum(values, 1.0)) @ axes.T @ root.T
    # In the axes of the whole, where each direction has the variance 1.
    full = square_root(whole)
    back = np.linalg.pinv(full)
    values, axes = np.linalg.eigh(back @ left @ back.T)
    return np.asarray(full @ (axes * np.sqrt(np.clip(values, 0.0, 1.0))) @ axes.T @ back)


def _loop(
    side: RobotSide, budget: ErrorBudget, views: list[View], A: Array, sigma_px: float
) -> tuple[Array, Array, Array, tuple[Array, Array]]:
    """Of every view of the calibration: how far its target is from where the robot puts it, (n, 6), what is to be
    expected of a view that was kept out, (n, 6, 6), what an error of the pose does to it, (n, 6, 6), and what errors of
    camera and target do, (n, 6, 12), with the covariance (n, 6, 6) of its own noise."""
    once = np.zeros(len(views), dtype=np.int64)
    links = [Link("X", once, True), Link("A", once, side.in_hand), Link("Z", once)]
    values = [np.broadcast_to(side.X, A.shape), A, np.broadcast_to(side.Z, A.shape)]
    of_X, of_A, of_Z = (np.broadcast_to(M, (len(views), 6, 6)) for M in link_maps(links, values))
    camera = budget.camera
    if camera is None:
        raise InputError("the result holds no camera")
    found = target_poses(camera, views)
    steps = se3.local(product(links, values), found.T_camera_target)
    J = np.concatenate([of_X, of_Z], axis=-1)
    of_robot = np.diag(np.repeat([side.rotation, side.translation], 3) ** 2)
    own = of_A @ of_robot @ np.swapaxes(of_A, -1, -2) + sigma_px**2 * found.covariance
    return steps, J @ side.covariance[:12, :12] @ np.swapaxes(J, -1, -2) + own, of_A, (J, own)


def _alike(steps: Array, expected: Array) -> float:
    """Correlation of neighbouring views' errors, one sigma above what was found, 0 to 1; robust against single views
    that are far off."""
    n = len(steps)
    if n < FEWEST:
        return 1.0
    root = np.linalg.cholesky(expected + 1e-18 * np.eye(6))
    white = np.linalg.solve(root, steps[..., None])[..., 0]
    length = np.linalg.norm(white, axis=1)
    white = white / np.maximum(length / max(3 * median(length), 1e-12), 1.0)[:, None]
    lag = float(np.sum(white[1:] * white[:-1]) / max(np.sum(white**2), 1e-12))
    return float(np.clip(lag + 1 / np.sqrt(6 * (n - 1)), 0.0, 1.0))
