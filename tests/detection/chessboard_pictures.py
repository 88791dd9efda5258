"""Pictures of chessboards with exactly known corners: 4x4 sub-pixels with anti-aliased edges, then blur and noise.

Independent of the package's own renderer: a fault there must not hide a fault in detection.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SUBPIXELS = 4


@dataclass(frozen=True)
class Lens:
    """Brown's model with two radial terms."""

    f: float
    cx: float
    cy: float
    k1: float = 0.0
    k2: float = 0.0

    def project(self, p: Array) -> Array:
        """Pixels (n, 2) of points (n, 3) in the camera frame."""
        x, y = p[:, 0] / p[:, 2], p[:, 1] / p[:, 2]
        r2 = x * x + y * y
        g = 1 + self.k1 * r2 + self.k2 * r2 * r2
        return np.stack([self.f * x * g + self.cx, self.f * y * g + self.cy], axis=1)

    def rays(self, u: Array, v: Array) -> tuple[Array, Array]:
        """Undistorted x, y at z = 1, by fixed-point iteration to 1e-7."""
        xd, yd = (u - self.cx) / self.f, (v - self.cy) / self.f
        x, y = xd.copy(), yd.copy()
        for _ in range(12):
            r2 = x * x + y * y
            g = 1 + self.k1 * r2 + self.k2 * r2 * r2
            x, y = xd / g, yd / g
        return x, y


@dataclass(frozen=True)
class Pose:
    """Rotation vector and translation of the board in the camera, in squares."""

    rotation: tuple[float, float, float]
    translation: tuple[float, float, float]

    @property
    def R(self) -> Array:
        return cv2.Rodrigues(np.array(self.rotation))[0]


def corners(columns: int, rows: int, pose: Pose, lens: Lens) -> Array:
    """True pixels (rows * columns, 2) of the inner corners, row by row."""
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1).astype(float)
    return lens.project(points @ pose.R.T + np.array(pose.translation))


def picture(
    columns: int,
    rows: int,
    pose: Pose,
    lens: Lens,
    size: tuple[int, int],
    *,
    blur: float = 0.7,
    noise: float = 2.0,
    seed: int = 0,
    dark: float = 40.0,
    light: float = 200.0,
    backdrop: float = 110.0,
    margin: float = 0.6,
    light_field: Array | None = None,
) -> NDArray[np.uint8]:
    """A board with a white margin (squares) on a grey backdrop; size = (width, height)."""
    w, h = size
    outline = lens.project(_outline(columns, rows, margin) @ pose.R.T + np.array(pose.translation))
    u0, v0 = np.clip(np.floor(outline.min(axis=0)).astype(int) - 4, 0, [w, h])
    u1, v1 = np.clip(np.ceil(outline.max(axis=0)).astype(int) + 5, 0, [w, h])
    image = np.full((h, w), float(backdrop))
    image[v0:v1, u0:u1] = _board(
        np.arange(u0, u1, dtype=float),
        np.arange(v0, v1, dtype=float),
        columns,
        rows,
        pose,
        lens,
        dark,
        light,
        backdrop,
        margin,
    )
    if blur > 0:
        image = cv2.GaussianBlur(image, (0, 0), blur, borderType=cv2.BORDER_REPLICATE)
    if light_field is not None:
        image = image * light_field
    image = image + noise * np.random.default_rng(seed).standard_normal(image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _outline(columns: int, rows: int, margin: float) -> Array:
    t = np.linspace(0, 1, 20)
    x0, x1, y0, y1 = -1 - margin, columns + margin, -1 - margin, rows + margin
    xs, ys = x0 + (x1 - x0) * t, y0 + (y1 - y0) * t
    edges = [(xs, 0 * t + y0), (xs, 0 * t + y1), (0 * t + x0, ys), (0 * t + x1, ys)]
    x, y = (np.concatenate([e[i] for e in edges]) for i in (0, 1))
    return np.stack([x, y, 0 * x], axis=1)


def _board(u, v, columns, rows, pose, lens, dark, light, backdrop, margin):
    u, v = np.meshgrid(u, v)
    R, t = pose.R, np.array(pose.translation)

    def plane(u, v):  # where the ray meets z = 0 of the board: R^T (s ray - t) has no third component there
        x, y = lens.rays(u, v)
        scale = (R[:, 2] @ t) / (R[0, 2] * x + R[1, 2] * y + R[2, 2])
        p = np.stack([scale * x - t[0], scale * y - t[1], scale - t[2]])
        return np.tensordot(R[:, 0], p, 1), np.tensordot(R[:, 1], p, 1)

    a0, b0 = plane(u, v)
    # Within a pixel the map is linear to some 1e-4 px.
    (av, au), (bv, bu) = np.gradient(a0), np.gradient(b0)
    slope_a, slope_b = (np.maximum(np.hypot(p, q) / SUBPIXELS, 1e-9) for p, q in ((au, av), (bu, bv)))

    def side(q, slope):  # -1 ... 1 over one sub-pixel across the nearest line of the grid, sign alternating by squares
        nearest = np.rint(q)
        return (1 - 2 * np.abs(np.mod(nearest, 2))) * np.clip(2 * (q - nearest) / slope, -1, 1)

    def within(q, slope, low, high):  # 0 ... 1
        return np.clip((q - low) / slope + 0.5, 0, 1) * np.clip((high - q) / slope + 0.5, 0, 1)

    total = np.zeros_like(a0)
    offsets = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS - 0.5
    for dv in offsets:
        for du in offsets:
            a, b = a0 + au * du + av * dv, b0 + bu * du + bv * dv
            # Square (0, 0) to (1, 1) is dark, as is the outermost one behind corner (0, 0).
            white = 0.5 - 0.5 * side(a, slope_a) * side(b, slope_b)
            squares = within(a, slope_a, -1, columns) * within(b, slope_b, -1, rows)
            paper = within(a, slope_a, -1 - margin, columns + margin) * within(b, slope_b, -1 - margin, rows + margin)
            on_paper = light + (dark + (light - dark) * white - light) * squares
            total += backdrop + (on_paper - backdrop) * paper
    return total / SUBPIXELS**2


def facing(
    columns: int, rows: int, lens: Lens, *, distance: float, tilt_deg: float, axis_deg: float, roll_deg: float = 0
) -> Pose:
    """The board's centre on the optical axis, tilted about an axis in the image plane, then rolled."""
    axis = np.deg2rad(axis_deg)
    tilt = np.deg2rad(tilt_deg) * np.array([np.cos(axis), np.sin(axis), 0.0])
    R = cv2.Rodrigues(tilt)[0] @ cv2.Rodrigues(np.array([0.0, 0.0, np.deg2rad(roll_deg)]))[0]
    centre = np.array([(columns - 1) / 2, (rows - 1) / 2, 0.0])
    t = np.array([0.0, 0.0, distance]) - R @ centre
    return Pose(tuple(cv2.Rodrigues(R)[0].ravel()), tuple(t))
