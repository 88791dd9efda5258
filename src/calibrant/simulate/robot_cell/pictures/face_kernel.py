"""A sheet's face drawn into a picture, compiled: for each pixel that shows it, the mean of the artwork over its area.

`simulate.render` does the same with NumPy for pictures of a sheet alone, and is this kernel's test.
"""

from __future__ import annotations

import numpy as np
from numba import types

from calibrant.compiled import compiled

_f8 = types.float64
_picture = types.uint8[:, :, ::1]
_texture = types.Array(types.uint8, 3, "C", readonly=True)
_clearance = types.Array(types.float32, 2, "C", readonly=True)
_depth = types.Array(types.float32, 2, "C", readonly=True)
_rays = types.Array(types.float64, 3, "C", readonly=True)
_plane = types.Array(types.float64, 2, "C", readonly=True)
_pattern = types.Array(types.float64, 2, "C", readonly=True)
_window = types.UniTuple(types.intp, 4)


@compiled(
    types.void(_picture, _depth, _rays, _plane, _texture, _clearance, _pattern, _window, _f8, _f8, _f8, _f8, _f8, _f8)
)
def draw_face(  # type: ignore[no-untyped-def]
    picture, depth, rays, H, texture, clearance, pattern, window, paper, ink, close, slope_u, slope_v, offset
):
    """H (3, 3): from rays (z = 1) to homogeneous texels, its last row n . ray / offset, 1 / depth of the plane.

    depth: of the window; pattern (k, 2): places in a pixel, -1/2 to 1/2; paper, ink: greys; close: metres by
    which the depth may differ from the plane's, slope_u, slope_v: |n_x| / fx, |n_y| / fy, how it changes from pixel to
    pixel.
    """
    first_row, last_row, first_column, last_column = window
    height, width = rays.shape[0], rays.shape[1]
    rows, columns = clearance.shape
    count = pattern.shape[0]
    for r in range(first_row, last_row):
        below = r + 1 if r + 1 < height else r - 1
        for c in range(first_column, last_column):
            x, y = rays[r, c, 0], rays[r, c, 1]
            w = H[2, 0] * x + H[2, 1] * y + H[2, 2]
            if w <= 1e-6:
                continue
            z = 1.0 / w
            if abs(depth[r - first_row, c - first_column] - z) > close + 0.5 * z * z / offset * (slope_u + slope_v):
                continue
            u = (H[0, 0] * x + H[0, 1] * y + H[0, 2]) * z
            v = (H[1, 0] * x + H[1, 1] * y + H[1, 2]) * z
            right = c + 1 if c + 1 < width else c - 1
            x, y = rays[r, right, 0], rays[r, right, 1]
            z = (right - c) / (H[2, 0] * x + H[2, 1] * y + H[2, 2])
            u_across = (H[0, 0] * x + H[0, 1] * y + H[0, 2]) * z - (right - c) * u
            v_across = (H[1, 0] * x + H[1, 1] * y + H[1, 2]) * z - (right - c) * v
            x, y = rays[below, c, 0], rays[below, c, 1]
            z = (below - r) / (H[2, 0] * x + H[2, 1] * y + H[2, 2])
            u_down = (H[0, 0] * x + H[0, 1] * y + H[0, 2]) * z - (below - r) * u
            v_down = (H[1, 0] * x + H[1, 1] * y + H[1, 2]) * z - (below - r) * v
            reach = 0.5 * (np.sqrt(u_across**2 + v_across**2) + np.sqrt(u_down**2 + v_down**2))
            i, j = int(np.floor(v + 0.5)), int(np.floor(u + 0.5))
            grey, cover = 0.0, 0.0
            if 0 <= i < rows and 0 <= j < columns and clearance[i, j] >= reach:
                grey, cover = float(texture[i, j, 0]), float(texture[i, j, 1])
            else:
                for k in range(count):
                    a, b = pattern[k, 0], pattern[k, 1]
                    s, t = u + a * u_across + b * u_down, v + a * v_across + b * v_down
                    j, i = int(np.floor(s)), int(np.floor(t))
                    s, t = s - j, t - i
                    for di in range(2):
                        for dj in range(2):
                            if 0 <= i + di < rows and 0 <= j + dj < columns:
                                part = (s if dj else 1.0 - s) * (t if di else 1.0 - t)
                                grey += part * texture[i + di, j + dj, 0]
                                cover += part * texture[i + di, j + dj, 1]
                grey, cover = grey / count, cover / count
            grey, cover = grey / 255.0, cover / 255.0
            printed = ink * cover + (paper - ink) * grey
            for k in range(3):
                value = printed + (1.0 - cover) * picture[r, c, k]
                picture[r, c, k] = np.uint8(min(255.0, max(0.0, np.rint(value))))
