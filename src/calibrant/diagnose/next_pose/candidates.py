"""Poses that a robot could take next: in reach, the target in view and in focus, nothing hit.

The target is put at random into the image, at the distances that are in focus, tilted and turned; inverse kinematics
say which of these views the arm reaches within its joint limits; what hits something is left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.solvers.setup import Setup
from calibrant.cameras import Camera
from calibrant.cancel import checkpoint
from calibrant.diagnose.next_pose.obstacles import Geometry
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3
from calibrant.robots.chain import KinematicChain
from calibrant.robots.inverse import solve_inverse

CANDIDATES = 300
"""More than 300 views lower what a plan of ten reaches by less than 2 % (benchmarks/next_pose.py)."""
_STARTS = 2
"""Starts of the inverse kinematics for each view: a view that none of them reaches is replaced by another view."""
_ITERATIONS = 40
"""Steps of each start: those that arrive do so within 30, the rest circle."""
_DRAWN = 3
"""Views drawn at once for each candidate wanted: about a third survives, and a large batch costs little more."""
_ROUNDS = 8
"""Rounds of drawing: an arm that reaches less than one in 24 of the views drawn is in the wrong place."""
_TOLERANCE = 1e-6
"""Radians (and a third of it in metres): far below any robot's accuracy, and faster than rounding."""
_MARGIN_PX = 3.0
"""Pixels that a point keeps from the image's edge: a corner needs its surroundings to be found."""


@dataclass(frozen=True)
class Wishes:
    """What a view must be: distance, metres from the camera to the target's middle; largest tilt and turn, degrees.

    in_view: share of the target's points that must lie in the image.
    """

    distance: tuple[float, float] = (0.3, 0.8)
    tilt_deg: float = 40.0
    turn_deg: float = 180.0
    in_view: float = 1.0


@dataclass(frozen=True, eq=False)
class Candidates:
    """Joint values q (n, joints), T_base_gripper and T_camera_target (n, 4, 4), and the points in view (n, p)."""

    q: Array
    T_base_gripper: Array
    T_camera_target: Array
    visible: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.q)

    def take(self, rows: NDArray[np.int64]) -> Candidates:
        """Some of them, in the order asked."""
        return Candidates(self.q[rows], self.T_base_gripper[rows], self.T_camera_target[rows], self.visible[rows])


def candidates(
    chain: KinematicChain,
    camera: Camera,
    points: Array,
    *,
    setup: Setup,
    X: Array,
    Z: Array,
    rng: np.random.Generator,
    wishes: Wishes | None = None,
    geometry: Geometry | None = None,
    count: int = CANDIDATES,
) -> Candidates:
    """Draw views that the arm can take.

    Args: points (p, 3) metres, target frame; X, Z as far as they are known, of the normal form A X B = Z. The flange is
    the gripper. Raises: RefusedError when the arm cannot take enough of them, saying what stands in the way.
    """
    wanted = wishes or Wishes()
    kept: list[Candidates] = []
    tally = np.zeros(4, dtype=np.int64)  # drawn, in view, reached, clear
    for _ in range(_ROUNDS):
        checkpoint()
        B = _board_views(points, _DRAWN * count, camera, wanted, rng)
        visible = in_view(camera, points, B)
        seen = visible.mean(axis=1) >= wanted.in_view
        B, visible = B[seen], visible[seen]
        A = Z @ se3.inverse(B) @ se3.inverse(X)
        robot = se3.inverse(A) if setup.robot_inverted else A
        q, reached = _reached(chain, robot, rng)
        clear = reached.copy()
        if geometry is not None and reached.any():
            clear[reached] = geometry.clear(chain, q[reached])
        tally += [_DRAWN * count, len(B), reached.sum(), clear.sum()]
        kept.append(Candidates(q[clear], robot[clear], B[clear], visible[clear]))
        if tally[3] >= count:
            break
    found = Candidates(*(np.concatenate([getattr(k, f) for k in kept])[:count] for f in Candidates.__annotations__))
    if len(found) < 3:
        raise RefusedError(_too_few(tally, wanted))
    return found


def _too_few(tally: NDArray[np.int64], wishes: Wishes) -> str:
    drawn, seen, reached, clear = (int(n) for n in tally)
    text = f"of {drawn} views drawn, {seen} have the target in view, the arm reaches {reached}, {clear} hit nothing"
    near, far = (1e3 * d for d in wishes.distance)
    if seen < 3:
        return f"{text}: the target does not fit into the image at {near:.0f} to {far:.0f} mm; allow larger distances"
    if reached < 3:
        return f"{text}: put the target nearer to the arm's middle, or check where camera and target were said to be"
    return f"{text}: make room, or check the geometry file"


def _board_views(points: Array, n: int, camera: Camera, wishes: Wishes, rng: np.random.Generator) -> Array:
    """Target poses (n, 4, 4): its middle on a random pixel's ray, tilted evenly over the disc, turned about it."""
    width, height = camera.image_size
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    ray = camera.unproject(rng.uniform((0.1 * width, 0.1 * height), (0.9 * width, 0.9 * height), size=(n, 2)))
    ray = np.where(np.isfinite(ray), ray, [0.0, 0.0, 1.0])
    direction = rng.uniform(0, 2 * np.pi, n)
    tilt = np.deg2rad(wishes.tilt_deg) * np.sqrt(rng.uniform(0, 1, n))
    axis = np.column_stack([np.cos(direction), np.sin(direction), np.zeros(n)])
    turn = np.deg2rad(wishes.turn_deg) * rng.uniform(-1, 1, n)
    R = so3.exp(tilt[:, None] * axis) @ so3.exp(turn[:, None] * [0, 0, 1])
    centre = ray / ray[:, 2:] * rng.uniform(*wishes.distance, size=(n, 1))
    return se3.make(R, centre - R @ middle)


def in_view(camera: Camera, points: Array, T_camera_target: Array) -> NDArray[np.bool_]:
    """Which points (p, 3) lie well inside the image of each pose (n, 4, 4): (n, p)."""
    p = se3.apply(T_camera_target[:, None], points)
    with np.errstate(invalid="ignore"):
        uv = camera.project(p)
        inside = np.all((uv > _MARGIN_PX) & (uv < np.array(camera.image_size) - 1 - _MARGIN_PX), axis=-1)
    return np.asarray(inside & camera.model.valid(camera.values, p.reshape(-1, 3)).reshape(inside.shape))


def _reached(chain: KinematicChain, T_base_gripper: Array, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
    """Joint values (n, joints) within the limits, and where there are some."""
    middle, half = 0.5 * (chain.lower + chain.upper), 0.5 * (chain.upper - chain.lower)
    spread = np.minimum(half, np.pi / 2)  # arms work around the middle of their range
    n = len(T_base_gripper)
    q, reached = np.zeros((n, len(middle))), np.zeros(n, dtype=np.bool_)
    for _ in range(_STARTS):
        checkpoint()
        rest = np.flatnonzero(~reached)
        if not len(rest):
            break
        start = middle + spread * rng.uniform(-1, 1, size=(len(rest), len(middle)))
        solution = solve_inverse(chain, T_base_gripper[rest], start, iterations=_ITERATIONS, tolerance=_TOLERANCE)
        good = solution.reached & chain.within_limits(solution.q)
        q[rest[good]], reached[rest[good]] = unwound(chain, solution.q[good]), True
    return q, reached


def unwound(chain: KinematicChain, q: Array) -> Array:
    """The same poses (n, joints) with every turning joint brought by whole turns as near to its middle as can be.

    Many arms turn by 360 degrees to either side: both ends of a cable's range are one pose.
    """
    turning = np.array([j.kind == "revolute" for j in chain.joints])
    middle = 0.5 * (chain.lower + chain.upper)
    middle = np.where(np.isfinite(middle), middle, 0.0)
    turns = np.where(turning, 2 * np.pi * np.round((q - middle) / (2 * np.pi)), 0.0)
    nearer = q - turns
    # Within limits of less than a turn, the joint is where it is.
    inside = (nearer >= chain.lower) & (nearer <= chain.upper)
    return np.where(inside, nearer, q)
