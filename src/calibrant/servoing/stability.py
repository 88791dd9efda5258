"""What errors of the calibration do to the loop: they change its way and its speed, and beyond a point it diverges.

With the wrong calibration (hat) and the true one, near where the features are wanted,

    d e / dt = -gain Q e,   Q = L^+ F L M M^-1        (hats on L^+ and on the inverse of M)

L the interaction matrix, F the ratio of true and assumed focal length by which measured errors are wrong, M the
mounting. The loop is stable where every eigenvalue of Q has a real part above 0 (Chaumette and Hutchinson 2006, part I,
eq. 17), and in steps of length h where |1 - gain h lambda| < 1. The smallest real part is the margin: 1 of a perfect
calibration; the share of the asked speed at which the slowest direction converges.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.geometry import se3, so3
from calibrant.servoing.laws.law import ALL
from calibrant.servoing.sight.features import Features
from calibrant.servoing.sight.interaction import point_rows
from calibrant.servoing.sight.mounting import Mounting

SIGMAS = 2.0
"""Of every error alone, at which the margin is told: beyond it one in twenty is."""
MOST_FOCAL, MOST_DEG = 4.0, 170.0
PRECISION = 1e-2


@dataclass(frozen=True)
class Margin:
    """margin: smallest real part of the eigenvalues of Q; at_sigma: the same with the worst single error at two sigmas
    of the calibration; focal_low, focal_high: the ratio assumed / true between which the loop is stable; hand_eye_deg:
    the turn of the mounting up to which it is, about whatever axis; overshoot: gain times period below which steps do
    not swing."""

    margin: float
    at_sigma: float
    focal_low: float
    focal_high: float
    hand_eye_deg: float
    overshoot: float


def loop_eigenvalues(
    wanted: Features,
    mounting: Mounting,
    T_base_gripper: Array,
    *,
    focal: float = 1.0,
    hand_eye: Array | None = None,
    subspace: Array = ALL,
) -> NDArray[np.complex128]:
    """Eigenvalues (m,) of Q for an assumed focal length `focal` times the true one, and an assumed mounting that is off
    by hand_eye (6,): assumed = retract(true, hand_eye).

    >>> import numpy as np
    >>> from calibrant.cameras import Camera
    >>> from calibrant.servoing.sight.features import features_of
    >>> camera = Camera.create("pinhole", {"fx": 600, "fy": 600, "cx": 320, "cy": 240}, image_size=(640, 480))
    >>> uv = np.array([[200.0, 150], [420, 160], [410, 330], [210, 320]])
    >>> wanted = features_of(camera, np.arange(4), uv, np.ones(4), np.full(4, 0.5))
    >>> loop_eigenvalues(wanted, Mounting("eye-in-hand", np.eye(4)), np.eye(4), focal=1.25).real.round(6).min() > 0
    np.True_
    """
    true = point_rows(wanted.xy, wanted.depth)
    # A focal length that is assumed too long makes directions too small and the target too far.
    assumed = point_rows(wanted.xy / focal, wanted.depth * focal) @ subspace
    Q = np.linalg.pinv(assumed) @ (true / focal)
    if hand_eye is not None:
        wrong = Mounting(mounting.setup, se3.retract(mounting.transform, hand_eye))
        M, M_wrong = mounting.camera_from_flange(T_base_gripper), wrong.camera_from_flange(T_base_gripper)
        Q = Q @ M @ np.linalg.inv(M_wrong)
    return np.linalg.eigvals(Q @ subspace).astype(np.complex128)


def margin_of(
    wanted: Features, camera: Camera, mounting: Mounting, T_base_gripper: Array, *, subspace: Array = ALL
) -> Margin:
    """The margin as the calibration stands, at its sigma, and how wrong it may be."""

    def smallest(focal: float = 1.0, hand_eye: Array | None = None) -> float:
        found = loop_eigenvalues(wanted, mounting, T_base_gripper, focal=focal, hand_eye=hand_eye, subspace=subspace)
        return float(found.real.min())

    f = camera.sigma.get("fx", 0.0) / camera.parameters["fx"]
    worst = [smallest(1 + SIGMAS * f), smallest(1 - SIGMAS * f)]
    if mounting.covariance is not None:
        values, axes = np.linalg.eigh(mounting.covariance)
        steps = SIGMAS * (axes * np.sqrt(np.maximum(values, 0.0))).T
        worst += [smallest(hand_eye=s * step) for step in steps for s in (-1, 1)]
    turns = [
        _limit(lambda deg, axis=axis: smallest(hand_eye=np.r_[np.deg2rad(deg) * axis, 0, 0, 0]), 0.0, MOST_DEG)  # type: ignore[misc]
        for axis in _axes()
    ]
    values = loop_eigenvalues(wanted, mounting, T_base_gripper, subspace=subspace)
    return Margin(
        margin=float(values.real.min()),
        at_sigma=min(worst),
        focal_low=1 / _limit(lambda r: smallest(1 / r), 1.0, MOST_FOCAL),
        focal_high=_limit(smallest, 1.0, MOST_FOCAL),
        hand_eye_deg=min(turns),
        overshoot=float(1 / np.abs(values).max()),
    )


def _axes() -> Array:
    """Directions of all octants, along the axes and between them (26, 3)."""
    grid = np.array(np.meshgrid([-1, 0, 1], [-1, 0, 1], [-1, 0, 1])).reshape(3, -1).T
    some = grid[np.any(grid != 0, axis=1)].astype(float)
    return np.asarray(some / np.linalg.norm(some, axis=1, keepdims=True))


def _limit(smallest: Callable[[float], float], good: float, most: float) -> float:
    """The value between a good one and the most at which the margin is gone, by bisection; the most where it is not."""
    for bad in np.linspace(good, most, 18)[1:]:
        if smallest(float(bad)) <= 0:
            break
        good = float(bad)
    else:
        return most
    while bad - good > PRECISION * max(bad, 1.0):
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if smallest(middle) > 0 else (good, middle)
    return good


def turned(mounting: Mounting, degrees: float, axis: Array) -> Mounting:
    """The mounting turned about an axis (3,) of its own, as one whose calibration is that wrong."""
    turn = so3.exp(np.deg2rad(degrees) * axis / np.linalg.norm(axis))
    return Mounting(mounting.setup, mounting.transform @ se3.make(turn, np.zeros(3)), mounting.covariance)
