"""Drawn photographs of ChArUco boards whose corners are known: every pixel is the mean of samples over its area."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from calibrant.detection.opencv import marker_cells
from calibrant.targets.charuco import Charuco

Array = NDArray[np.float64]
SIZE = (480, 360)
SUBPIXELS = 3


def board_grey(target: Charuco, xy: Array, *, ground: float) -> Array:
    """Grey 0 ... 1 of the printed board at (..., 2) metres; `ground` outside."""
    square = np.floor(xy / target.square).astype(int)
    column, row = square[..., 0], square[..., 1]
    inside = (column >= 0) & (row >= 0) & (column < target.columns) & (row < target.rows)
    first_column, first_row = target.marker_squares[0]
    marked = (column + row) % 2 == (first_column + first_row) % 2
    grey = np.where(marked, 1.0, 0.0)
    cells = np.stack([marker_cells(target.dictionary, i) for i in range(target.marker_count)])
    ids = np.zeros((target.rows, target.columns), dtype=int)
    ids[target.marker_squares[:, 1], target.marker_squares[:, 0]] = np.arange(target.marker_count)
    in_marker = (xy - target.square * square - 0.5 * (target.square - target.marker)) / target.marker
    cell = np.floor(in_marker * cells.shape[1]).astype(int)
    on_marker = inside & marked & np.all((cell >= 0) & (cell < cells.shape[1]), axis=-1)
    which = ids[np.clip(row, 0, target.rows - 1), np.clip(column, 0, target.columns - 1)]
    c = np.clip(cell, 0, cells.shape[1] - 1)
    grey = np.where(on_marker, cells[which, c[..., 1], c[..., 0]], grey)
    grey = 1.0 - grey if target.inverted else grey
    return np.where(inside, grey, ground)


def photograph(
    target: Charuco,
    H_image_board: Array,
    *,
    size: tuple[int, int] = SIZE,
    blur_px: float = 0.7,
    noise: float = 2.0,
    seed: int = 0,
    bend: float = 0.0,
) -> tuple[NDArray[np.uint8], Array]:
    """A grey image of the board and the true pixels of its corners, (n, 2).

    H_image_board (3, 3): board metres -> pixels; bend: radial distortion, relative at half the image's width.
    """
    width, height = size
    offsets = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS - 0.5
    u = (np.arange(width)[:, None] + offsets).ravel()
    v = (np.arange(height)[:, None] + offsets).ravel()
    pixels = np.stack(np.meshgrid(u, v), axis=-1)
    # Jittered within its cell, a sample is an unbiased view of the cell: a fixed raster would move edges along it by up
    # to half a cell.
    rng = np.random.default_rng(seed)
    pixels += rng.uniform(-0.5, 0.5, pixels.shape) / SUBPIXELS
    xy = _apply(np.linalg.inv(H_image_board), _straightened(pixels, size, bend))
    fine = board_grey(target, xy, ground=0.0 if target.inverted else 1.0)
    blurred = cv2.GaussianBlur(fine, (0, 0), blur_px * SUBPIXELS)
    image = blurred.reshape(height, SUBPIXELS, width, SUBPIXELS).mean(axis=(1, 3))
    noisy = 40.0 + 170.0 * image + rng.normal(0.0, noise, image.shape)
    truth = _bent(_apply(H_image_board, target.points[:, :2]), size, bend)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8), truth


def facing(target: Charuco, *, quad: Array) -> Array:
    """Homography that puts the board's outer corners (top left, top right, bottom right, bottom left) on a quad, px."""
    w, h = target.columns * target.square, target.rows * target.square
    board = np.array([[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]], dtype=np.float32)
    return np.asarray(cv2.getPerspectiveTransform(board, np.asarray(quad, dtype=np.float32)), dtype=np.float64)


def _apply(H: Array, xy: Array) -> Array:
    p = xy @ H[:, :2].T + H[:, 2]
    return p[..., :2] / p[..., 2:]


def _centred(uv: Array, size: tuple[int, int]) -> Array:
    return (uv - 0.5 * (np.array(size) - 1.0)) / (0.5 * size[0])


def _straightened(uv: Array, size: tuple[int, int], bend: float) -> Array:
    """The division model: r_straight = r / (1 + bend r^2), r in half widths of the image."""
    c = _centred(uv, size)
    r2 = (c**2).sum(axis=-1, keepdims=True)
    return c / (1.0 + bend * r2) * (0.5 * size[0]) + 0.5 * (np.array(size) - 1.0)


def _bent(uv: Array, size: tuple[int, int], bend: float) -> Array:
    """Inverse of `_straightened`: bend s r^2 - r + s = 0, the root that is s when nothing bends."""
    c = _centred(uv, size)
    s2 = (c**2).sum(axis=-1, keepdims=True)
    return c * 2.0 / (1.0 + np.sqrt(1.0 - 4.0 * bend * s2)) * (0.5 * size[0]) + 0.5 * (np.array(size) - 1.0)
