"""Cameras that look together, as a calibration has them: lenses, places, and the covariance of all of it in one.

    T_f_i = T_p_f^-1 T_p_i,    d T_f_i = M_f d T_p_f + M_i d T_p_i

with p the frame that the result places both in, f the first camera. What lens and place of a camera share stands off
the diagonal: a centre of the picture that is wrong by a pixel, and a camera that is turned by as much, cannot be told
apart, and cancel in every depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.reprojection.links import Link, link_maps, product
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.geometry import se3


@dataclass(frozen=True, eq=False)
class Eyes:
    """Two cameras or more: names, cameras, T_first_camera (n, 4, 4), metres, the first of them the identity.

    covariance (6 (n - 1) + p, 6 (n - 1) + p): places of all but the first camera in `se3.retract`'s chart, then the
    parameters of all lenses; zero for what was given as exact. joint: whether the result held places and lenses
    together; otherwise they are taken as independent, which makes depths look less certain than they are.
    """

    names: tuple[str, ...]
    cameras: tuple[Camera, ...]
    T_first_camera: Array
    covariance: Array
    joint: bool = True

    def __post_init__(self) -> None:
        n = len(self.cameras)
        T = se3.check(self.T_first_camera, name="T_first_camera")
        size = 6 * (n - 1) + sum(len(c.values) for c in self.cameras)
        if n < 2 or len(self.names) != n or T.shape != (n, 4, 4) or np.shape(self.covariance) != (size, size):
            raise InputError(
                f"{n} cameras need {n} names, T_first_camera ({n}, 4, 4) and a covariance ({size}, {size}), got "
                f"{len(self.names)}, {T.shape} and {np.shape(self.covariance)}; two cameras at least"
            )

    def __repr__(self) -> str:
        mm = ", ".join(f"{1e3 * np.linalg.norm(T[:3, 3]):.2f} mm" for T in self.T_first_camera[1:])
        return f"Eyes({', '.join(self.names)}: {mm} apart)"

    @property
    def baseline(self) -> float:
        """Distance of the first two cameras, metres."""
        return float(np.linalg.norm(self.T_first_camera[1, :3, 3]))

    def lens_columns(self, i: int) -> slice:
        """Where the parameters of camera i stand in the covariance."""
        first = 6 * (len(self.cameras) - 1) + sum(len(c.values) for c in self.cameras[:i])
        return slice(first, first + len(self.cameras[i].values))


def eyes_of(result: CalibrationResult, names: Sequence[str] | None = None) -> Eyes:
    """The cameras of a result, by default its first two.

    Raises: InputError for fewer than two cameras, unknown names, cameras whose places the result does not relate.

    >>> import numpy as np
    >>> from calibrant.cameras import Camera
    >>> from calibrant.data import CalibrationResult, as_transform
    >>> from calibrant.geometry import se3
    >>> from calibrant.perceive.stereo.eyes import eyes_of
    >>> lens = {"fx": 800.0, "fy": 800.0, "cx": 319.5, "cy": 239.5}
    >>> camera = Camera.create("pinhole", lens, image_size=(640, 480))
    >>> place = as_transform("left", "right", se3.make(np.eye(3), [0.1, 0.0, 0.0]))
    >>> eyes_of(CalibrationResult("rig", "ok", cameras={"left": camera, "right": camera}, transforms=(place,)))
    Eyes(left, right: 100.00 mm apart)
    """
    wanted = tuple(names) if names is not None else tuple(result.cameras)[:2]
    unknown = [n for n in wanted if n not in result.cameras]
    if unknown or len(set(wanted)) < 2 or len(set(wanted)) != len(wanted):
        known = ", ".join(result.cameras) or "none"
        what = f"no camera {unknown[0]!r} in the result" if unknown else "two different cameras are needed"
        raise InputError(f"{what}; it has: {known}. A rig (calibrant stereo, calibrant rig) has two or more")
    cameras = tuple(result.cameras[n] for n in wanted)
    parent = _common_parent(result, wanted)
    placed = [n for n in wanted if n != parent]
    C, joint = _covariance(result, parent, placed, wanted)
    # From the frame they are placed in to that of the first camera.
    T_parent = {n: np.eye(4) if n == parent else result.transform(parent, n).matrix for n in wanted}
    M = np.zeros((6 * (len(wanted) - 1) + C.shape[0] - 6 * len(placed), C.shape[0]))
    T_first = [np.eye(4)]
    once = np.zeros(1, dtype=np.int64)
    for row, name in enumerate(wanted[1:]):
        links = [Link(wanted[0], once, inverted=True), Link(name, once)]
        values = [T_parent[wanted[0]][None], T_parent[name][None]]
        T_first.append(product(links, values)[0])
        for who, part in zip((wanted[0], name), link_maps(links, values)):
            if who in placed:
                at = 6 * placed.index(who)
                M[6 * row : 6 * row + 6, at : at + 6] += part[0]
    lens = C.shape[0] - 6 * len(placed)
    M[-lens:, -lens:] = np.eye(lens)
    return Eyes(wanted, cameras, np.stack(T_first), M @ C @ M.T, joint)


def _common_parent(result: CalibrationResult, names: Sequence[str]) -> str:
    """The frame that all cameras are placed in: another frame, or one of them."""
    pairs = {(t.parent, t.child) for t in result.transforms}
    for parent in dict.fromkeys(p for p, _ in pairs):
        if all(n == parent or (parent, n) in pairs for n in names):
            return parent
    # Stated the other way round, or not at all.
    known = ", ".join(f"{p} -> {c}" for p, c in sorted(pairs)) or "none"
    raise InputError(
        f"the result does not say where {names[1]} is from {names[0]}; it has the transforms {known}. Calibrate them "
        "together: calibrant stereo, calibrant rig"
    )


def _covariance(
    result: CalibrationResult, parent: str, placed: Sequence[str], names: Sequence[str]
) -> tuple[Array, bool]:
    """Covariance of the placed cameras' transforms and all lenses, in that order; whether the result has it whole."""
    frames = [(parent, n) for n in placed]
    joint = result.joint_covariance
    sizes = {n: len(c.values) for n, c in result.cameras.items()}
    if joint is not None and set(frames) <= set(joint.frames) and set(names) <= set(joint.cameras):
        starts, at = {}, 6 * len(joint.frames)
        for n in joint.cameras:
            starts[n], at = at, at + sizes[n]
        rows = [6 * joint.frames.index(f) + np.arange(6) for f in frames]
        rows += [starts[n] + np.arange(sizes[n]) for n in names]
        index = np.concatenate(rows)
        return np.asarray(joint.whole)[np.ix_(index, index)], True
    blocks = [result.transform(*f).covariance for f in frames] + [result.cameras[n].covariance for n in names]
    widths = [6] * len(frames) + [sizes[n] for n in names]
    out = np.zeros((sum(widths), sum(widths)))
    at = 0
    for block, width in zip(blocks, widths):
        if block is not None:
            out[at : at + width, at : at + width] = block
        at += width
    return out, not any(block is not None for block in blocks)
