"""How late the camera's time stamps are, from pictures taken while the arm moves.

A picture stamped t was exposed at t - tau. What the camera saw stands still or moves straight,

    p_i(tau) = T_base_gripper(t_i - tau) X p_camera_i = p_0 + v t_i

so a wrong tau lets the object sway with the arm. p_0 and v are linear, tau is found by Gauss-Newton with

    dp_i/dtau = -(velocity of the camera's view of the point at t_i - tau)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import RefusedError
from calibrant.geometry import se3
from calibrant.geometry.motion import Motion

LEAST = 8
ITERATIONS = 30
STEP_S = 1e-3
LARGEST_S = 1.0
TELLING = 3.0
"""Times its sigma that a sway of the arm's own speed must be for the latency to be told."""


@dataclass(frozen=True)
class Latency:
    """seconds, and 1 sigma of them."""

    seconds: float
    sigma: float = 0.0


def latency_from(times: Sequence[float], seen: Array, motion: Motion, transform: Array) -> Latency:
    """The latency of stamps `times` (n,) of an object seen at (n, 3), camera frame, metres.

    motion: T_base_gripper as the controller recorded it; transform: T_gripper_camera. The arm moves to and fro
    meanwhile; the object stands or moves straight.
    Raises: RefusedError for too few pictures, or motions that do not tell the latency.
    """
    t = np.asarray(times, dtype=np.float64)
    if len(t) < LEAST:
        raise RefusedError(f"{len(t)} pictures tell no latency; take {LEAST} or more while the arm moves to and fro")
    tau = 0.0

    def places(late: float) -> Array:
        return np.asarray(se3.apply(motion.at(t - late) @ transform, seen))

    about = np.stack([np.ones(len(t)), t - t.mean()], axis=1)
    project = np.eye(len(t)) - about @ np.linalg.pinv(about)  # what a straight motion leaves
    for _ in range(ITERATIONS):
        r = project @ places(tau)
        J = project @ (places(tau + STEP_S) - places(tau - STEP_S)) / (2 * STEP_S)
        if not np.any(np.abs(J) > 1e-9):
            break
        step = -float(np.sum(J * r) / np.sum(J * J))
        tau = float(np.clip(tau + step, -LARGEST_S, LARGEST_S))
        if abs(step) < 1e-7:
            break
    spare = 3 * len(t) - 7
    noise = float(np.sqrt(np.sum(r * r) / spare))
    sway = float(np.sqrt(np.sum(J * J)))
    sigma = noise / sway if sway > 0 else float("inf")
    if not sigma < LARGEST_S / TELLING or abs(tau) >= LARGEST_S:
        raise RefusedError(
            "the arm's motion does not tell the camera's latency: move to and fro, across the line of sight and not at "
            "a constant speed"
        )
    return Latency(tau, sigma)
