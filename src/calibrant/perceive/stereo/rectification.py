"""Rectification: two pictures as cameras that look the same way would have taken them, so that matches share a row.

Each camera is turned about its centre, by half of what their directions differ and then both alike until the baseline
is an axis of the picture (`geometry.rectifying`, after Bouguet; manual 003, 6.6). Both pictures have
one focal length, one row of the principal point, and where asked one column of it:

    pinhole    u = cx + f X / Z,     v = cy + f Y / Z
    cylinder   u = cx + f X / rho,   v = cy + f atan2(Y, Z),   rho = sqrt(Y^2 + Z^2), about the baseline

The cylinder's rows are the half planes that hold the baseline, so that it serves lenses that see beyond a pinhole's 90
deg across the rows. In both, u_left - u_right - (cx_left - cx_right) = f B / depth, depth Z or rho.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.geometry.rectifying import rectifying_turns
from calibrant.perceive.output_cameras import WIDEST_DEG, border_rays, flattened, pinhole
from calibrant.perceive.stereo.eyes import Eyes
from calibrant.perceive.undistort import Maps, maps_of

Projection = Literal["pinhole", "cylinder"]
PROJECTIONS: tuple[Projection, ...] = get_args(Projection)
Principal = Literal["equal", "own"]
PRINCIPALS: tuple[Principal, ...] = get_args(Principal)
Size = tuple[int, int]


@dataclass(frozen=True)
class RectifiedView:
    """One rectified picture: its projection, f, cx, cy px, size; along: 0 for a baseline along x, 1 along y."""

    projection: Projection
    f: float
    cx: float
    cy: float
    image_size: Size
    along: int

    def rays(self, uv: Array) -> Array:
        """Directions (..., 3) of pixels (..., 2) in the rectified frame; NaN beyond a whole turn of the cylinder."""
        a, b = (uv[..., 0] - self.cx) / self.f, (uv[..., 1] - self.cy) / self.f
        if self.projection == "pinhole":
            return np.stack([a, b, np.ones_like(a)], axis=-1)
        x, angle = (a, b) if self.along == 0 else (b, a)
        angle = np.where(np.abs(angle) <= np.pi, angle, np.nan)
        return self._ordered(x, np.sin(angle), np.cos(angle))

    def project(self, p: ArrayLike) -> Array:
        """Pixels (..., 2) of points (..., 3) in the rectified frame; NaN behind a pinhole."""
        return np.asarray(self.f * _flat(self.projection, self.along, p) + [self.cx, self.cy])

    def depth(self, p: Array) -> Array:
        """What a disparity is inverse to (...): Z of a pinhole, the distance from the baseline of a cylinder."""
        return p[..., 2] if self.projection == "pinhole" else np.hypot(p[..., 1 - self.along], p[..., 2])

    def _ordered(self, along: Array, across: Array, z: Array) -> Array:
        xy = (along, across) if self.along == 0 else (across, along)
        return np.stack([*np.broadcast_arrays(*xy, z)], axis=-1)


@dataclass(frozen=True, eq=False)
class Rectification:
    """A pair and its rectified pictures; build it with `rectification`.

    R_rectified_camera (2, 3, 3): turns of left and right; baseline: where right is from left along the rows, metres,
    negative where the sides are exchanged; views: left and right.
    """

    eyes: Eyes
    R_rectified_camera: Array
    baseline: float
    views: tuple[RectifiedView, RectifiedView]

    @property
    def along(self) -> int:
        """0 where the cameras stand beside each other, 1 where they stand above each other."""
        return self.views[0].along

    @cached_property
    def maps(self) -> tuple[Maps, Maps]:
        """From each rectified picture to the camera's own."""
        left, right = (self._maps(i) for i in (0, 1))
        return left, right

    def _maps(self, i: int) -> Maps:
        R, view = self.R_rectified_camera[i], self.views[i]
        return maps_of(self.eyes.cameras[i], lambda uv: view.rays(uv) @ R, view.image_size)

    def pixels(self, i: int, uv: ArrayLike) -> Array:
        """Where pixels (..., 2) of camera i are in its rectified picture; NaN where they have no ray."""
        return self.views[i].project(self.eyes.cameras[i].unproject(uv) @ self.R_rectified_camera[i].T)

    def own_pixels(self, i: int, uv: Array) -> Array:
        """Where pixels (..., 2) of rectified picture i are in the camera's own; NaN where it does not see them."""
        rays = self.views[i].rays(uv) @ self.R_rectified_camera[i]
        camera = self.eyes.cameras[i]
        known = np.isfinite(rays).all(axis=-1)
        safe = np.where(known[..., None], rays, [0.0, 0.0, 1.0])
        known = known & camera.model.sees(camera.values, safe) & camera.model.inside(camera.values, safe)
        return np.where(known[..., None], camera.project(safe), np.nan)

    def row_errors(self, uv: ArrayLike) -> Array:
        """What matches (2, n, 2), pixels of the cameras' own pictures, are off from one row (or column), (n,), px."""
        m = np.asarray(uv, dtype=np.float64)
        left, right = (self.pixels(i, m[i]) for i in (0, 1))
        return np.asarray(left[:, 1 - self.along] - right[:, 1 - self.along])

    @property
    def Q(self) -> Array:
        """(4, 4) with Q (u, v, d, 1)^T ~ (X, Y, Z, 1)^T in the left rectified frame, as cv2.reprojectImageTo3D takes
        it, metres; d = u_left - u_right (v, where the baseline is along y). Raises: InputError for a cylinder, which
        has none."""
        left, right = self.views
        if left.projection != "pinhole":
            raise InputError("a cylindrical pair has no Q: its depth is f B / d from the baseline, not Z")
        shift = (left.cx - right.cx, left.cy - right.cy)[self.along]
        return np.array(
            [
                [1, 0, 0, -left.cx],
                [0, 1, 0, -left.cy],
                [0, 0, 0, left.f],
                [0, 0, 1 / self.baseline, -shift / self.baseline],
            ]
        )

    @property
    def cameras(self) -> tuple[Camera, Camera]:
        """The rectified cameras. Raises: InputError for a cylinder, which is no camera's model."""
        if self.views[0].projection != "pinhole":
            raise InputError("a cylindrical pair is of no camera model; its numbers are in `views`")
        left, right = (pinhole(v.f, v.f, v.cx, v.cy, v.image_size) for v in self.views)
        return left, right

    @property
    def T_left_right(self) -> Array:
        """(4, 4), metres: the right rectified camera in the left one."""
        t = np.zeros(3)
        t[self.along] = self.baseline
        return se3.make(np.eye(3), t)


def rectification(
    eyes: Eyes,
    *,
    alpha: float = 0.0,
    image_size: Size | None = None,
    projection: Projection = "pinhole",
    principal: Principal = "equal",
    focal_px: float | None = None,
) -> Rectification:
    """How to rectify the first two cameras.

    Args: alpha: 0, no pixel without a source, to 1, every source pixel is shown; image_size: of the rectified pictures,
    by default the first camera's; principal: "equal" puts both principal points into one column, "own" gives each
    picture its own; focal_px: in place of the one that alpha chooses.
    Raises: InputError for values out of range, cameras behind each other, pictures that have no part in common.

    >>> import numpy as np
    >>> from calibrant.cameras import Camera
    >>> from calibrant.geometry import se3
    >>> from calibrant.perceive.stereo.eyes import Eyes
    >>> from calibrant.perceive.stereo.rectification import rectification
    >>> lens = {"fx": 800.0, "fy": 800.0, "cx": 319.5, "cy": 239.5}
    >>> camera = Camera.create("pinhole", lens, image_size=(640, 480))
    >>> places = np.stack([np.eye(4), se3.make(np.eye(3), [0.1, 0.0, 0.0])])
    >>> pair = rectification(Eyes(("left", "right"), (camera, camera), places, np.zeros((14, 14))))
    >>> round(pair.baseline, 6), pair.along, [round(v.f, 6) for v in pair.views]
    (0.1, 0, [800.0, 800.0])
    """
    if not 0 <= alpha <= 1:
        raise InputError(f"alpha is {alpha:g}; expected 0 (no pixel without a source) to 1 (every source pixel shown)")
    if projection not in PROJECTIONS or principal not in PRINCIPALS:
        raise InputError(
            f"projection is {', '.join(PROJECTIONS)} and principal {', '.join(PRINCIPALS)}; got {projection!r}, "
            f"{principal!r}"
        )
    if focal_px is not None and not (np.isfinite(focal_px) and focal_px > 0):
        raise InputError(f"the focal length is {focal_px:g} px; expected one above 0")
    size = image_size or eyes.cameras[0].image_size
    names = (eyes.names[0], eyes.names[1])
    R, along, baseline = rectifying_turns(eyes.T_first_camera[1], names=names)
    border = [_flat_border(c, turn, projection, along) for c, turn in zip(eyes.cameras, R)]
    f, centres = _frame(border, alpha, size, along, principal)
    f = f if focal_px is None else focal_px
    middle = (np.array(size) - 1) / 2
    left, right = (
        RectifiedView(projection, f, float(cx), float(cy), size, along) for cx, cy in (middle - f * c for c in centres)
    )
    return Rectification(eyes, R, baseline, (left, right))


def _flat(projection: Projection, along: int, p: ArrayLike) -> Array:
    """Coordinates (..., 2) in the picture of f = 1 about its principal point."""
    q = np.asarray(p, dtype=np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        if projection == "pinhole":
            return np.where(q[..., 2:] > 0, q[..., :2] / q[..., 2:], np.nan)
        across = q[..., 1 - along]
        ab = (q[..., along] / np.hypot(across, q[..., 2]), np.arctan2(across, q[..., 2]))
    return np.stack(ab if along == 0 else ab[::-1], axis=-1)


def _flat_border(camera: Camera, R: Array, projection: Projection, along: int) -> Array:
    """Coordinates (9, 9, 2) of pixels spread over the picture, those along the baseline `WIDEST_DEG` at most."""
    rays = border_rays(camera) @ R.T
    if projection == "pinhole":
        return flattened(rays)
    flat = _flat(projection, along, rays)
    most = np.tan(np.deg2rad(WIDEST_DEG))
    flat[..., along] = flat[..., along].clip(-most, most)
    return flat


def _frame(
    border: list[Array], alpha: float, size: Size, along: int, principal: Principal
) -> tuple[float, list[Array]]:
    """The focal length, and for each picture which coordinates are in its middle."""
    inner, outer = [], []
    for xy in border:
        left, right, top, bottom = xy[:, 0, 0], xy[:, -1, 0], xy[0, :, 1], xy[-1, :, 1]
        inner.append(np.array([[left.max(), right.min()], [top.max(), bottom.min()]]))
        outer.append(np.array([[left.min(), right.max()], [top.min(), bottom.max()]]))
    common = {1 - along} | ({along} if principal == "equal" else set())
    for axis in common:
        low, high = max(r[axis, 0] for r in inner), min(r[axis, 1] for r in inner)
        for r in inner:
            r[axis] = low, high
        low, high = min(r[axis, 0] for r in outer), max(r[axis, 1] for r in outer)
        for r in outer:
            r[axis] = low, high
    if any(np.any(r[:, 1] <= r[:, 0]) for r in inner):
        raise InputError(
            "the rectified pictures have no part in common: the cameras look past each other"
            + ("; try --principal own" if principal == "equal" else "")
        )
    span = np.array(size) - 1.0
    fill = max(float(np.max(span / (r[:, 1] - r[:, 0]))) for r in inner)
    show = min(float(np.min(span / (r[:, 1] - r[:, 0]))) for r in outer)
    f = (1 - alpha) * fill + alpha * show
    return f, [(1 - alpha) * i.mean(axis=1) + alpha * o.mean(axis=1) for i, o in zip(inner, outer)]
