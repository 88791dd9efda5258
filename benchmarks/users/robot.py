"""An arm of six joints and what is wrong with it: its own equations, in which no calibrator's chain takes part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from users.rigid import Array, rigid, step_between, turn

ALPHA = np.array([np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0])
HOME = np.array([0.3, -1.3, 1.5, -1.4, -1.3, 0.5])
"""A bent elbow and a bent wrist."""
WITHIN = np.array([[0, 1, 1, 1, 1, 0], [0, 1, 1, 1, 1, 0], [1, 1, 1, 1, 1, 0], [1, 1, 1, 1, 1, 0]], dtype=float)
"""Of joint zero, d, a, alpha (4, 6): those that are not a move of the base or the flange."""


@dataclass(frozen=True, eq=False)
class Arm:
    """Denavit and Hartenberg's numbers: zero, d, a, alpha (4, 6), radians and metres."""

    links: Array

    def poses(self, q: Array) -> Array:
        """T_base_flange (m, 4, 4) of joint angles (m, 6)."""
        return self.chain(q)[:, -1]

    def chain(self, q: Array) -> Array:
        """Frames (m, 7, 4, 4) from the base to the flange."""
        zero, d, a, alpha = self.links
        frames = [np.broadcast_to(np.eye(4), (len(q), 4, 4))]
        for i in range(6):
            o = np.zeros(len(q))
            about_z = turn(np.stack([o, o, q[:, i] + zero[i]], 1))
            along = np.array([a[i], 0.0, d[i]])
            frames.append(frames[-1] @ rigid(about_z @ turn([alpha[i], 0, 0]), about_z @ along))
        return np.stack(frames, axis=1)

    def reach(self, T: Array, start: Array) -> tuple[Array, Array]:
        """Joint angles (m, 6) that bring the flange to T (m, 4, 4), and which did (m,), by damped Newton steps."""
        q = np.array(start)
        for _ in range(50):
            frames = self.chain(q)
            now = frames[:, -1]
            error = step_between(now, T)
            axes, origins = frames[:, :6, :3, 2], frames[:, :6, :3, 3]
            J = np.concatenate([axes, np.cross(axes, now[:, None, :3, 3] - origins)], axis=2).swapaxes(1, 2)
            far = np.linalg.norm(error, axis=1)
            if far.max() < 1e-12:
                break
            damped = J @ J.swapaxes(1, 2) + (1e-4 * np.minimum(far, 1) ** 2 + 1e-12)[:, None, None] * np.eye(6)
            step = (J.swapaxes(1, 2) @ np.linalg.solve(damped, error[..., None]))[..., 0]
            q = q + step * np.minimum(1, 0.5 / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-9))
        return q, np.linalg.norm(step_between(self.poses(q), T), axis=1) < 1e-9


def draw_arm(rng: np.random.Generator) -> Arm:
    """An arm that reaches about 0.9 m."""
    d = np.array([0.16, 0.0, 0.0, 0.13, 0.1, 0.1]) * rng.uniform(0.85, 1.15, 6)
    a = np.array([0.0, -0.43, -0.39, 0.0, 0.0, 0.0]) * rng.uniform(0.9, 1.1, 6)
    return Arm(np.stack([np.zeros(6), d, a, ALPHA]))


Fault = Callable[[Arm, Array, np.random.Generator], Callable[[Array], Array]]
"""(arm, joints of the views (v, 6), rng) -> joints (m, 6) -> where the flange truly is (m, 4, 4)."""


def links(mm: float, deg: float, *, within: bool = False) -> Fault:
    """Lengths and angles of links, and zeros of joints, are not those that the controller counts with."""

    def fault(arm: Arm, q: Array, rng: np.random.Generator) -> Callable[[Array], Array]:
        off = rng.standard_normal((4, 6)) * np.array([np.deg2rad(deg), 1e-3 * mm, 1e-3 * mm, np.deg2rad(deg)])[:, None]
        true = Arm(arm.links + off * (WITHIN if within else 1))
        return true.poses

    return fault


def offsets(deg: float) -> Fault:
    """Zeros of the joints 2 to 5 are off."""

    def fault(arm: Arm, q: Array, rng: np.random.Generator) -> Callable[[Array], Array]:
        off = np.deg2rad(deg) * rng.standard_normal(6) * WITHIN[0]
        return lambda joints: arm.poses(joints + off)

    return fault


def eccentric(deg: float) -> Fault:
    """Gears and encoders that err by a sine of the joint's angle."""

    def fault(arm: Arm, q: Array, rng: np.random.Generator) -> Callable[[Array], Array]:
        phase, size = rng.uniform(0, 2 * np.pi, 6), np.deg2rad(deg) * np.sqrt(2)
        return lambda joints: arm.poses(joints + size * np.sin(joints + phase))

    return fault


def sag(deg: float) -> Fault:
    """Shoulder and elbow give way under the arm's weight: most where the arm is stretched out."""

    def fault(arm: Arm, q: Array, rng: np.random.Generator) -> Callable[[Array], Array]:
        most = np.deg2rad(deg) * rng.uniform(0.5, 1.5, 2)

        def poses(joints: Array) -> Array:
            bend = np.zeros_like(joints)
            bend[:, 1], bend[:, 2] = most[0] * np.cos(joints[:, 1]), most[1] * np.cos(joints[:, 1] + joints[:, 2])
            return arm.poses(joints + bend)

        return poses

    return fault


def backlash(deg: float) -> Fault:
    """Joints stop short by half the play, on the side they come from: it depends on the view before."""

    def fault(arm: Arm, q: Array, rng: np.random.Generator) -> Callable[[Array], Array]:
        side = np.sign(np.diff(q, axis=0, prepend=q[:1] - rng.standard_normal((1, 6))))

        def poses(joints: Array) -> Array:
            play = side if len(joints) == len(side) else rng.choice([-1, 1], joints.shape)
            return arm.poses(joints + np.deg2rad(deg) / 2 * play)

        return poses

    return fault
