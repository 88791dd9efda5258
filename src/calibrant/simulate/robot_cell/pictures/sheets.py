"""Boards and markers in the cell's pictures, drawn to a fraction of a pixel.

A graphics card samples a texture at the middle of each pixel and lets small squares alias: corners would be off by
tenths of a pixel. So MuJoCo draws sheets blank, and where its depth is that of the sheet, the artwork is drawn through
the true lens, a pixel being the mean over its area. What stands before the sheet hides it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.geometry import se3
from calibrant.simulate.render import sheet_window
from calibrant.simulate.robot_cell.pictures.face_kernel import draw_face
from calibrant.simulate.robot_cell.pictures.lens import LensMap
from calibrant.simulate.robot_cell.world.light import Light
from calibrant.simulate.texture import Texture, rasterise
from calibrant.targets import Artwork

_PAPER, _INK = 0.92, 0.10
"""Reflectance of matt paper and toner."""
_TEXELS = (256, 512, 1024, 2048, 4096)
_CLOSE_M = 0.0012
"""Depths that agree this well are of one thing: thinner than anything that lies on a sheet."""
_GRID = 4
"""Points a pixel on edges along each side, each the mean over a texel: an edge's place is right to a hundredth of a
pixel and on average exact."""


def _pattern() -> Array:
    """A turned grid: its points have as many different columns and rows as points."""
    k = np.arange(_GRID)
    a, b = np.meshgrid(k, k)
    fine = (np.column_stack([(_GRID * a + b).ravel(), (_GRID * b + _GRID - 1 - a).ravel()]) + 0.5) / _GRID**2
    return np.ascontiguousarray(fine - 0.5)


_PATTERN = _pattern()


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


@dataclass(frozen=True, eq=False)
class Eye:
    """Whose picture it is: the camera, its pixels' rays, where it is, and the light on what it sees."""

    camera: Camera
    lens: LensMap
    T_base_camera: Array
    light: Light


def draw_sheet(
    picture: NDArray[np.uint8], depth: NDArray[np.float32], sheet: Sheet, T_base_sheet: Array, eye: Eye
) -> None:
    """Draw a sheet into the picture (h, w, 3), where the depth, of the lens's pinhole picture, shows its face."""
    T = se3.inverse(eye.T_base_camera) @ T_base_sheet
    rows, columns = sheet_window(sheet.artwork, eye.camera, T)
    normal, place = T[:3, 2], T[:3, 3]  # the normal goes into the sheet
    offset = float(normal @ place)
    if rows.stop <= rows.start or columns.stop <= columns.start or offset <= 0:
        return
    inverse_depth = eye.lens.rays[rows, columns] @ (normal / offset)
    if inverse_depth.max() <= 0:
        return
    fx, fy = eye.camera.parameters["fx"], eye.camera.parameters["fy"]
    texture = sheet.texture(1.0 / float(inverse_depth.max()) / max(fx, fy))
    H = np.empty((3, 3))
    H[2] = normal / offset
    for k in range(2):
        # x = (R_k . ray - t . R_k / z) z, in texels whose middles are whole numbers.
        at = float(place @ T[:3, k]) + texture.origin[k]
        H[k] = T[:3, k] / texture.texel - (at / texture.texel + 0.5) * H[2]
    down = eye.light.direction @ eye.T_base_camera[:3, :3]
    shade = 255.0 * (eye.light.ambient + eye.light.diffuse * max(0.0, float(down @ normal)))
    window = (rows.start, rows.stop, columns.start, columns.stop)
    near = eye.lens.depth(depth, rows, columns)
    draw_face(
        picture, near, eye.lens.rays, H, texture.data, texture.clearance, _PATTERN, window,
        _PAPER * shade, _INK * shade, _CLOSE_M, abs(normal[0]) / fx, abs(normal[1]) / fy, offset,
    )  # fmt: skip
