"""How far something moved or is to be moved, with its uncertainty, in numbers and in words that a person can act on.

Directions are those of the camera as it was: x to the right, y down, z forward, as its picture shows them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, isfinite, log10

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.geometry import se3, so3

SIGNIFICANT = 3.0
"""Sigmas from which a component is told: of six, one is told by chance in sixty."""
SIDES = (("right", "left"), ("down", "up"), ("forward", "back"))
TURNS = (("up", "down"), ("to the right", "to the left"), ("clockwise", "anticlockwise"))
"""Turns about x, y, z of a camera that looks along z, as one behind it sees them."""


@dataclass(frozen=True, eq=False)
class Movement:
    """A move along (3,) millimetres and a turn about (3,) degrees of three axes, with 1 sigma of each."""

    mm: Array
    mm_sigma: Array
    deg: Array
    deg_sigma: Array


@dataclass(frozen=True, eq=False)
class AtWork:
    """How far points at the workpiece are from where they should be: (3,) millimetres in the camera's axes with their
    covariance (3, 3), and (2,) pixels to the right and down with theirs."""

    mm: Array
    mm_covariance: Array
    px: Array
    px_covariance: Array

    @property
    def size(self) -> tuple[float, float]:
        """Distance and 1 sigma along it, millimetres."""
        return _length(self.mm, self.mm_covariance)

    @property
    def size_px(self) -> tuple[float, float]:
        """Distance in the picture and 1 sigma along it, pixels."""
        return _length(self.px, self.px_covariance)

    @property
    def across(self) -> tuple[float, float]:
        """Distance and 1 sigma, of its worse direction, across the line of sight, millimetres."""
        C = self.mm_covariance[:2, :2]
        return float(np.linalg.norm(self.mm[:2])), float(np.sqrt(np.linalg.eigvalsh(C)[-1]))

    @property
    def along(self) -> tuple[float, float]:
        """Distance and 1 sigma along the line of sight, millimetres."""
        return abs(float(self.mm[2])), float(np.sqrt(self.mm_covariance[2, 2]))


def movement(T_before_after: Array, covariance: Array) -> Movement:
    """The movement that a transform (4, 4) with its covariance (6, 6) is."""
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    turn = so3.log(T_before_after[:3, :3])
    return Movement(1e3 * T_before_after[:3, 3], 1e3 * sigma[3:], np.rad2deg(turn), np.rad2deg(sigma[:3]))


def of_camera(camera: Camera, T_before_after: Array, covariance: Array, places: Sequence[Array]) -> AtWork:
    """What a camera's movement does to points (3,) of its frame: the mean over them, as its picture shows it.

    p' = D^-1 p,    dp' = D_R^T (hat(p - D_t) omega - v)
    """
    steps, jacobians, pixels, to_pixels = [], [], [], []
    R = T_before_after[:3, :3]
    for p in places:
        arm = p - T_before_after[:3, 3]
        after = R.T @ arm
        J = R.T @ np.concatenate([so3.hat(arm), -np.eye(3)], axis=1)
        uv, J_point, _ = camera.model.project_with_jacobians(camera.values, np.stack([p, after]))
        steps.append(after - p)
        jacobians.append(J)
        pixels.append(uv[1] - uv[0])
        to_pixels.append(J_point[1] @ J)
    J, K = np.mean(jacobians, axis=0), np.mean(to_pixels, axis=0)
    return AtWork(
        1e3 * np.mean(steps, axis=0), 1e6 * J @ covariance @ J.T, np.mean(pixels, axis=0), K @ covariance @ K.T
    )


def of_target(T_before_after: Array, covariance: Array, T_frame_target: Array, middle: Array) -> Movement:
    """The movement of a target's middle (3,), target frame, along the axes of the frame that it is fixed to."""
    R, arm = T_frame_target[:3, :3], T_before_after[:3, :3] @ middle
    J = R @ np.concatenate([-so3.hat(arm), np.eye(3)], axis=1)
    C = J @ covariance @ J.T
    turned = R @ covariance[:3, :3] @ R.T
    step = 1e3 * R @ (se3.apply(T_before_after, middle) - middle)
    turn = np.rad2deg(R @ so3.log(T_before_after[:3, :3]))
    return Movement(step, 1e3 * np.sqrt(np.diag(C)), turn, np.rad2deg(np.sqrt(np.diag(turned))))


def undone(T_before_after: Array, covariance: Array) -> Movement:
    """The movement that undoes a movement, along the axes of the camera as it is now.

    D^-1 = (R^T, -R^T t),   d(D^-1) = -(R^T omega, R^T (v + t x omega))
    """
    R, t = T_before_after[:3, :3], T_before_after[:3, 3]
    J = np.zeros((6, 6))
    J[:3, :3] = J[3:, 3:] = -R.T
    J[3:, :3] = -R.T @ so3.hat(t)
    return movement(se3.inverse(T_before_after), J @ covariance @ J.T)


def to_wanted(T_base_camera: Array, covariance: Array, T_base_wanted: Array) -> Movement:
    """The movement from where a camera is known to be, with its covariance (6, 6) in the base, to where it is wanted.

    T_now_wanted = (R^T R_w, R^T (t_w - t)); an error (omega, v) of the camera's place in the base changes it by
    -(R^T omega, R^T (v + omega x (t_w - t))).
    """
    R, way = T_base_camera[:3, :3], T_base_wanted[:3, 3] - T_base_camera[:3, 3]
    J = np.zeros((6, 6))
    J[:3, :3] = J[3:, 3:] = -R.T
    J[3:, :3] = R.T @ so3.hat(way)
    return movement(se3.inverse(T_base_camera) @ T_base_wanted, J @ covariance @ J.T)


def guidance(to_go: Movement) -> str:
    """What a person is to do: "move 12.0 ± 0.2 mm to the left, 4.0 ± 0.2 mm up and turn 0.80 ± 0.02 deg clockwise", of
    what is certain; empty where nothing is.

    >>> to_go = movement(se3.make(so3.exp([0, 0, np.deg2rad(0.8)]), [-0.012, -0.004, 0.0]), 1e-9 * np.eye(6))
    >>> guidance(to_go)
    'move 12.000 ± 0.032 mm to the left, 4.000 ± 0.032 mm up and turn 0.8000 ± 0.0018 deg clockwise'
    """
    return _moves(to_go, "move", "turn")


def camera_words(moved: Movement) -> str:
    """ "moved 1.2 ± 0.2 mm to the left and turned 0.100 ± 0.020 deg down", of what is certain; else empty."""
    return _moves(moved, "moved", "turned")


def _moves(moved: Movement, move: str, turn: str) -> str:
    """What is certain of a movement, with its verbs."""
    places = [
        f"{figure(abs(v), s)} mm {'to the ' if k == 0 else ''}{SIDES[k][int(v < 0)]}"
        for k, v, s in _told(moved.mm, moved.mm_sigma)
    ]
    turns = [f"{figure(abs(v), s)} deg {TURNS[k][int(v < 0)]}" for k, v, s in _told(moved.deg, moved.deg_sigma)]
    parts = [f"{move} {', '.join(places)}"] if places else []
    parts += [f"{turn} {', '.join(turns)}"] if turns else []
    return " and ".join(parts)


def target_words(moved: Movement, frame: str) -> str:
    """ "moved x 3.0 ± 0.2, y 0.1 ± 0.2, z 0.0 ± 0.3 mm in the base and turned 0.1 ± 0.1 deg"."""
    place = ", ".join(f"{axis} {figure(v, s)}" for axis, v, s in zip("xyz", moved.mm, moved.mm_sigma))
    turn = float(np.linalg.norm(moved.deg))
    k = int(np.argmax(np.abs(moved.deg)))
    return f"moved {place} mm in the {frame}, turned {figure(turn, moved.deg_sigma[k])} deg"


def side_words(step: Array, covariance: Array | None = None, *, least: float = 0.3) -> str:
    """The direction of a step (2,) or (3,) in the picture: "to the right and down". Parts below `least` of it are left
    out, and those that are not certain beside one that is."""
    sigma = np.zeros(len(step)) if covariance is None else np.sqrt(np.diag(covariance))
    certain = np.abs(step) > SIGNIFICANT * sigma
    size = float(np.linalg.norm(step[certain] if certain.any() else step))
    shown = (np.abs(step) >= least * size) & (certain | ~certain.any()) & (size > 0)
    told = [("to the " if k == 0 else "") + SIDES[k][int(step[k] < 0)] for k in np.flatnonzero(shown)]
    return " and ".join(told)


def figure(value: float, sigma: float) -> str:
    """ "1.23 ± 0.12", rounded to two digits of sigma."""
    if not isfinite(sigma) or sigma <= 0:
        return f"{value:.3g}"
    decimals = min(max(1 - floor(log10(sigma)), 0), 6)
    return f"{value:.{decimals}f} ± {sigma:.{decimals}f}"


def _told(values: Array, sigmas: Array) -> list[tuple[int, float, float]]:
    """The components that are certain, the largest first; of these none below a tenth of the largest."""
    rows = [(k, float(v), float(s)) for k, (v, s) in enumerate(zip(values, sigmas)) if abs(v) > SIGNIFICANT * s]
    most = max((abs(v) for _, v, _ in rows), default=0.0)
    return sorted((r for r in rows if abs(r[1]) >= 0.1 * most), key=lambda r: -abs(r[1]))


def _length(step: Array, C: Array) -> tuple[float, float]:
    size = float(np.linalg.norm(step))
    if size == 0:
        return 0.0, float(np.sqrt(max(float(np.linalg.eigvalsh(C)[-1]), 0.0)))
    along = step / size
    return size, float(np.sqrt(max(float(along @ C @ along), 0.0)))
