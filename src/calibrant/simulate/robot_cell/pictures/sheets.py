"""Boards and markers in the cell's pictures, drawn to a fraction of a pixel.

A graphics card samples a texture at the middle of each pixel and lets small squares alias: corners would be off by
tenths of a pixel. So MuJoCo draws sheets blank, and where its depth is that of the sheet, `simulate.render` draws the
artwork through the true lens, a pixel being the mean over its area. What stands before the sheet hides it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.simulate.render import sheet_seen, sheet_window
from calibrant.simulate.robot_cell.world.light import Light
from calibrant.simulate.texture import Texture, rasterise
from calibrant.targets import Artwork

_PAPER, _INK = 0.92, 0.10
"""Reflectance of matt paper and toner."""
_TEXELS = (256, 512, 1024, 2048, 4096)
_SAMPLES = 16
"""Points a pixel on edges, each the mean over a texel: the coverage is exact to 1/32 and to the texels' 8 bits."""
_CLOSE_M = 0.0012
"""Depths that agree this well are of one thing: thinner than anything that lies on a sheet."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """A printed thing: the name of its body, whose frame is the target's, and its artwork."""

    body: str
    artwork: Artwork

    def texture(self, pixel_m: float) -> Texture:
        """The artwork, drawn once and kept, as fine as pixels of this size on it need: three texels a pixel or more.

        A texel is the mean over its area, so the coarser drawing moves no edge; three a pixel widen the blur of
        0.7 px by 1 %.
        """
        x0, y0, x1, y1 = self.artwork.bounds
        wanted = 3.0 * max(x1 - x0, y1 - y0) / pixel_m
        return rasterise(self.artwork, next((n for n in _TEXELS if n >= wanted), _TEXELS[-1]))


def draw_sheet(
    picture: NDArray[np.uint8],
    depth: NDArray[np.float32],
    sheet: Sheet,
    T_camera_sheet: Array,
    *,
    camera: Camera,
    rays: Array,
    light: Light,
    R_camera_base: Array,
) -> NDArray[np.uint8]:
    """The picture (h, w, 3) with a sheet drawn into it, where the depth (h, w) shows its face.

    rays (h, w, 3) of the pixels with z = 1.
    """
    rows, columns = sheet_window(sheet.artwork, camera, T_camera_sheet)
    if rows.stop <= rows.start or columns.stop <= columns.start:
        return picture
    normal = T_camera_sheet[:3, 2]  # into the sheet
    offset = float(normal @ T_camera_sheet[:3, 3])
    part = rays[rows, columns]
    along = part @ normal
    if offset <= 0 or not np.any(along > 1e-6):
        return picture
    plane = offset / np.where(along > 1e-6, along, np.nan)
    fx, fy = camera.parameters["fx"], camera.parameters["fy"]
    with np.errstate(invalid="ignore"):
        # The depth picture is that of the nearest pixel: on a slope it may be off by half a pixel's rise.
        slope = plane**2 / offset * (abs(normal[0]) / fx + abs(normal[1]) / fy)
        seen = np.abs(depth[rows, columns] - plane) < _CLOSE_M + 0.5 * slope
    if not seen.any():
        return picture
    used_rows, used_columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    inner = (slice(used_rows[0], used_rows[-1] + 1), slice(used_columns[0], used_columns[-1] + 1))
    texture = sheet.texture(float(np.nanmin(plane[inner])) / max(fx, fy))
    grey, cover = sheet_seen(texture, part[inner], T_camera_sheet, samples=_SAMPLES)
    shade = light.ambient + light.diffuse * max(0.0, float((R_camera_base @ light.direction) @ normal))
    printed = 255.0 * shade * (_INK * cover + (_PAPER - _INK) * grey)
    out = picture.copy()
    window = out[rows, columns][inner]  # a view
    mask = seen[inner]
    behind = window[mask].astype(np.float32)
    mixed = printed[mask][:, None] + behind * (1 - cover[mask])[:, None]
    window[mask] = np.clip(np.rint(mixed), 0, 255).astype(np.uint8)
    return out
