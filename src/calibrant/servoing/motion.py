"""From the camera's wanted twist to a twist of the flange that the arm can make: joint limits, singularities, view.

The flange's twist is that of one small problem,

    min |D (M x - xi)|^2 + mu^2 |B x|^2,   q' = B x,   B = J^T (J J^T + mu^2)^-1
    subject to   q' within the joints' speeds, slowed down towards their ranges,
                 every feature that nears the picture's border: d(distance)/dt >= -k distance

M the mounting, J the arm's Jacobian (by differences of the controller's own forward kinematics), B how a controller
shares a twist among its joints, D scaling turns by the target's distance. mu rises where the smallest singular value
falls (Nakamura and Hanafusa 1986): singular poses are passed with an error instead of a jump. Where the control law
leaves twists free, the joints are led to the middle of their ranges with them; an arm with more joints than it needs
is led there at rest, its flange where it is: gradient projection (Liegeois 1977; Chaumette and Marchand 2001).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import Robot, RobotLimits
from calibrant.geometry import se3
from calibrant.servoing.laws.law import Pull
from calibrant.servoing.sight.features import Features
from calibrant.servoing.sight.interaction import point_rows
from calibrant.servoing.sight.mounting import Mounting
from calibrant.servoing.within import least_squares_within

STEP = 1e-4
"""Of a joint for the differences, radians: their error is its square, above rounding by far."""
SINGULAR = 0.08
"""Smallest singular value below which damping begins: turns of 1 rad/s then take a joint 12 rad/s."""
DAMPING = 0.05
LEAST_DAMPING = 1e-4
NEAR = 3.0
"""1/s: a joint or a feature may cover this part of its way to the limit in a second."""
BORDER = 0.02
"""Of the picture's width: what features keep from its border, so that whole corners are seen."""
RANGE_MARGIN = np.deg2rad(1.0)
MIDDLE_GAIN = 0.2
FREEDOM = 6
"""Joints that a pose takes: with more, the arm can move within itself."""
SELF_MOTION, SELF_STEP = 30, 0.1
"""Steps towards the middle, each a tenth of the way: nine tenths in all."""
SAME_POSE = 1e-5
"""Metres and radians that the flange may be off after it."""


@dataclass(frozen=True)
class Speeds:
    """The fastest that the camera moves: m/s and rad/s."""

    linear: float = 0.25
    angular: float = 1.0


@dataclass(frozen=True, eq=False)
class Step:
    """flange (6,): the twist for `Robot.drive`; camera (6,): that of the camera; bounds: what held it back, in words;
    manipulability: the smallest singular value of the arm there."""

    flange: Array
    camera: Array
    bounds: tuple[str, ...]
    manipulability: float


def flange_jacobian(robot: Robot, joints: Array) -> Array:
    """d(flange's pose)/d(joints) (6, n), base axes, by central differences of the controller's forward kinematics."""
    columns = []
    for k in range(len(joints)):
        d = np.zeros(len(joints))
        d[k] = STEP
        columns.append(se3.local(robot.forward(joints - d), robot.forward(joints + d)) / (2 * STEP))
    return np.stack(columns, axis=1)


def step_of(
    robot: Robot,
    mounting: Mounting,
    camera: Camera,
    pull: Pull,
    seen: Features,
    keep: Features,
    *,
    gain: float,
    speeds: Speeds,
) -> Step:
    """The next motion. keep: features that stay in the picture. Raises: DeviceError when the robot is silent."""
    joints, limits = robot.joints(), robot.limits
    arm = flange_jacobian(robot, joints)
    to_camera = mounting.camera_from_flange(robot.pose())
    scale = np.r_[np.full(3, seen.middle_depth), np.ones(3)]
    asked = slowed(gain * pull.twist, speeds)
    middle = MIDDLE_GAIN * (limits.joints.mean(axis=1) - joints) * (np.ptp(limits.joints, axis=1) < 4 * np.pi)
    asked = asked + pull.free @ slowed(to_camera @ arm @ middle, speeds)
    smallest = float(np.linalg.svd(scale[:, None] * to_camera @ arm, compute_uv=False)[-1])
    mu = LEAST_DAMPING + DAMPING * max(0.0, 1 - smallest / SINGULAR) ** 2
    share = arm.T @ np.linalg.inv(arm @ arm.T + mu**2 * np.eye(6))
    A = np.vstack([scale[:, None] * to_camera, mu * share])
    b = np.r_[scale * asked, np.zeros(len(joints))]
    G, h, words = bounds_of(limits, joints)
    rows, low = view_bounds(camera, keep)
    G, h = np.vstack([G @ share, rows @ to_camera]), np.r_[h, low]
    flange = least_squares_within(A, b, G, h)
    held = np.flatnonzero(G @ flange <= h + 1e-6)
    said = [words[i] if i < len(words) else "the picture's border" for i in held]
    said += ["a singular pose"] if mu > 2 * LEAST_DAMPING else []
    return Step(flange, to_camera @ flange, tuple(dict.fromkeys(said)), smallest)


def recentred(robot: Robot, joints: Array) -> Array | None:
    """Joints (n,) nearer to the middle of their ranges with the flange where it is; None for an arm that has no choice.

    q <- q + J+ (T_flange - T(q)) + (I - J+ J) k (q_middle - q)
    """
    if len(joints) <= FREEDOM:
        return None
    limits, T, q = robot.limits.joints, robot.forward(joints), joints.copy()
    for _ in range(SELF_MOTION):
        J = flange_jacobian(robot, q)
        P = np.linalg.pinv(J, rcond=1e-3)
        towards = SELF_STEP * (limits.mean(axis=1) - q)
        q = q + P @ se3.local(robot.forward(q), T) + towards - P @ (J @ towards)
        q = np.clip(q, limits[:, 0] + RANGE_MARGIN, limits[:, 1] - RANGE_MARGIN)
    for _ in range(5):
        q = q + np.linalg.pinv(flange_jacobian(robot, q), rcond=1e-3) @ se3.local(robot.forward(q), T)
    same = float(np.abs(se3.local(robot.forward(q), T)).max()) < SAME_POSE
    inside = bool(np.all((q > limits[:, 0]) & (q < limits[:, 1])))
    return q if same and inside else None


def slowed(twist: Array, speeds: Speeds) -> Array:
    """The twist (6,), shortened as a whole to the speeds."""
    turn, shift = float(np.linalg.norm(twist[:3])), float(np.linalg.norm(twist[3:]))
    return twist / max(1.0, turn / speeds.angular, shift / speeds.linear)


def bounds_of(limits: RobotLimits, joints: Array) -> tuple[Array, Array, list[str]]:
    """G q' >= h and a name for each row: speeds, and ranges approached ever slower."""
    n = len(joints)
    low, high = limits.joints[:, 0] + RANGE_MARGIN, limits.joints[:, 1] - RANGE_MARGIN
    up = np.minimum(limits.speeds, NEAR * np.maximum(high - joints, 0.0))
    down = np.minimum(limits.speeds, NEAR * np.maximum(joints - low, 0.0))
    words = [_which(k, up[k] < limits.speeds[k]) for k in range(n)]
    words += [_which(k, down[k] < limits.speeds[k]) for k in range(n)]
    return np.vstack([-np.eye(n), np.eye(n)]), -np.r_[up, down], words


def _which(k: int, in_range: bool) -> str:
    return f"the {'range' if in_range else 'speed'} of joint {k + 1}"


def view_bounds(camera: Camera, seen: Features) -> tuple[Array, Array]:
    """Rows (4, 6) and bounds (4,) on the camera's twist: the features nearest to the four borders stay inside."""
    width, height = camera.image_size
    margin = BORDER * width
    to_px = np.linalg.inv(seen.slope)
    L = np.einsum("nij,njk->nik", to_px, point_rows(seen.xy, seen.depth).reshape(-1, 2, 6))
    rows, low = [], []
    for axis, size in ((0, width), (1, height)):
        first, last = int(np.argmin(seen.uv[:, axis])), int(np.argmax(seen.uv[:, axis]))
        rows += [L[first, axis], -L[last, axis]]
        low += [seen.uv[first, axis] - margin, size - 1 - margin - seen.uv[last, axis]]
    return np.array(rows), -NEAR * np.maximum(np.array(low), 0.0)
