"""Photos of a board by a lens: projection, drawn scenes, and the least sigma that such photos allow.

Own equations. Frames: camera x right, y down, z ahead; board z into the board; pixel centres at whole numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from users.rigid import Array, rigid, turn

SIZES = ((640, 480), (1280, 720), (1280, 1024), (1920, 1080))
Pixels = Callable[[Array], Array]


@dataclass(eq=False)
class Photos:
    """A set of photos as it is taken: `told` is what the calibrator is told of the board, `real` what the board is.

    K (v, 4) fx fy cx cy and D (v, 5) k1 k2 p1 p2 k3 of each view; T (v, 4, 4) T_camera_board; sigma pixels a axis.
    after: what happens to the pixels (v, n, 2) once they are seen, noise included; truths: cameras (4,) each of which a
    person would call right, the calibrator's being judged by the nearest; keep (v, n): points that are seen.
    """

    size: tuple[int, int]
    K: Array
    D: Array
    told: Array
    real: Array
    T: Array
    sigma: float
    rng: np.random.Generator
    lens: str = "brown"
    noise: Callable[[Photos], Array] | None = None
    after: list[Pixels] = field(default_factory=list)
    truths: list[Array] = field(default_factory=list)
    keep: Array | None = None
    options: dict[str, object] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.T)

    @property
    def middle(self) -> Array:
        """The image's centre, pixels."""
        return (np.array(self.size) - 1) / 2

    def shape(self) -> Array:
        """Where points lie on the board, -1 to 1 along both sides (n, 2)."""
        half = np.ptp(self.told[:, :2], axis=0) / 2
        return (self.told[:, :2] - self.told[:, :2].mean(axis=0)) / half

    def take(self) -> Array:
        """The pixels (v, n, 2) that a detector reports."""
        uv = project(self.real, self.T, self.K, self.D, self.lens)
        draws = self.rng.standard_normal(uv.shape)
        uv = uv + (self.sigma * draws if self.noise is None else self.noise(self))
        for change in self.after:
            uv = change(uv)
        return uv


def project(points: Array, T: Array, K: Array, D: Array, lens: str = "brown") -> Array:
    """Pixels (v, n, 2) of board points (n, 3) or (v, n, 3) at T (v, 4, 4)."""
    p = points @ np.swapaxes(T[:, :3, :3], -1, -2) + T[:, None, :3, 3]
    x, y = p[..., 0] / p[..., 2], p[..., 1] / p[..., 2]
    k1, k2, p1, p2, k3 = (D[:, i, None] for i in range(5))
    s = x * x + y * y
    if lens == "brown":
        g = 1 + s * (k1 + s * (k2 + s * k3))
        x, y = x * g + 2 * p1 * x * y + p2 * (s + 2 * x * x), y * g + p1 * (s + 2 * y * y) + 2 * p2 * x * y
    elif lens == "fisheye":  # equidistant: the image's radius is the angle
        r = np.sqrt(s)
        g = np.arctan(r) / r
        x, y = x * g, y * g
    else:  # a wide lens of division type, which no few polynomial terms hold
        g = 2 / (1 + np.sqrt(1 - 4 * k1 * s))
        x, y = x * g, y * g
    return np.stack([K[:, 0, None] * x + K[:, 2, None], K[:, 1, None] * y + K[:, 3, None]], axis=-1)


@dataclass(frozen=True)
class Draw:
    """From what sets of photos are drawn: number of views, focal length in widths, largest roll and tilts, degrees."""

    views: tuple[int, int] = (10, 25)
    focal: tuple[float, float] = (0.7, 1.4)
    roll: float | None = None
    tilt: tuple[float, float] = (5.0, 50.0)
    fill: tuple[float, float] = (0.3, 0.75)
    lens: str = "brown"
    sigma: tuple[float, float] = (0.05, 0.4)


def draw_lens(rng: np.random.Generator, draw: Draw) -> tuple[tuple[int, int], Array, Array]:
    """(width, height), K (4,), D (5,) of a lens whose picture grows from the centre out, over the whole image.

    Pixels are square as lithography makes them, to 0.02 %.
    """
    size = SIZES[rng.integers(len(SIZES))]
    f = size[0] * rng.uniform(*draw.focal)
    centre = (np.array(size) - 1) / 2 + 0.012 * size[0] * rng.standard_normal(2)
    D = np.array([rng.uniform(-0.2, 0.05), rng.uniform(0.02, 0.06), *4e-4 * rng.standard_normal(2), 0.0])
    return size, np.array([f, f * (1 + 2e-4 * rng.standard_normal()), *centre]), D


def draw_board(rng: np.random.Generator) -> Array:
    """Corners (n, 3) of a chessboard of 150 to 400 mm, metres."""
    columns, rows = rng.integers(7, 12), rng.integers(5, 9)
    square = rng.uniform(0.02, 0.036)
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    return square * np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1).astype(float)


def look(
    rng: np.random.Generator, n: int, size: tuple[int, int], K: Array, D: Array, board: Array, draw: Draw
) -> Array:
    """n poses T_camera_board (n, 4, 4), the whole board in the picture, anywhere in it, tilted and rolled."""
    roll = draw.roll if draw.roll is not None else float(rng.choice([15.0, 45.0, 180.0]))
    found: list[Array] = []
    centre, width = board.mean(axis=0), np.ptp(board[:, 0])
    for _ in range(200):
        m = 400
        direction, tilt = rng.uniform(0, 2 * np.pi, m), np.deg2rad(rng.uniform(*draw.tilt, m))
        axis = np.stack([np.cos(direction), np.sin(direction), 0 * direction], axis=1)
        R = turn(tilt[:, None] * axis) @ turn(np.deg2rad(rng.uniform(-roll, roll, (m, 1))) * [0, 0, 1])
        z = K[0] * width / (rng.uniform(*draw.fill, m) * size[0])
        at = rng.uniform(0, 1, (m, 2)) * size
        place = np.stack([(at[:, 0] - K[2]) / K[0] * z, (at[:, 1] - K[3]) / K[1] * z, z], axis=1)
        T = rigid(R, place - R @ centre)
        uv = project(board, T, np.tile(K, (m, 1)), np.tile(D, (m, 1)), draw.lens)
        margin = 0.01 * size[0]
        inside = np.all((uv > margin) & (uv < np.array(size) - margin), axis=(1, 2))
        found.extend(T[inside])
        if len(found) >= n:
            return np.stack(found[:n])
    raise RuntimeError("the drawn board fits into no picture")


def draw_photos(seed: int, draw: Draw) -> Photos:
    """One set. The same seed gives the same lens, board and poses in every condition that draws alike."""
    rng = np.random.default_rng([2026, 11, seed])
    size, K, D = draw_lens(rng, draw)
    if draw.lens == "fisheye":
        D = np.zeros(5)
    elif draw.lens == "division":
        D = np.array([-0.25, 0, 0, 0, 0])
    board = draw_board(rng)
    n = int(rng.integers(draw.views[0], draw.views[1] + 1))
    sigma = float(np.exp(rng.uniform(*np.log(draw.sigma))))
    T = look(rng, n, size, K, D, board, draw)
    return Photos(
        size, np.tile(K, (n, 1)), np.tile(D, (n, 1)), board, board, T, sigma, rng, draw.lens, truths=[K.copy()]
    )  # fmt: skip


def slopes(photos: Photos) -> tuple[Array, Array]:
    """Derivatives of the pixels by the lens (v, 2n, 9) and by the board's pose (v, 2n, 6), by differences."""
    points, T, K, D = photos.told, photos.T, photos.K, photos.D
    lens = []
    for i in range(9):
        h = 1e-3 if i < 4 else 1e-6
        step = h * np.eye(9)[i]
        more, less = (project(points, T, K + s * step[:4], D + s * step[4:]) for s in (1, -1))
        lens.append((more - less) / (2 * h))
    pose = []
    for i in range(6):
        h = 1e-6
        step = h * np.eye(6)[i]
        shifted = [
            rigid(turn(s * step[:3]) @ T[:, :3, :3], T[:, :3, 3] + s * step[3:]) for s in (1, -1)
        ]  # along the camera's axes
        pose.append((project(points, shifted[0], K, D) - project(points, shifted[1], K, D)) / (2 * h))
    v = len(T)
    return np.stack(lens, -1).reshape(v, -1, 9), np.stack(pose, -1).reshape(v, -1, 6)


def least_covariance(photos: Photos) -> Array:
    """Covariance (4, 4) of fx fy cx cy that white noise allows at best (Cramer and Rao), lens terms and poses free."""
    J, P = slopes(photos)
    if photos.keep is not None:
        seen = np.repeat(photos.keep, 2, axis=1)[..., None]
        J, P = J * seen, P * seen
    JJ, JP, PP = (np.swapaxes(a, 1, 2) @ b for a, b in ((J, J), (J, P), (P, P)))
    F = np.sum(JJ - JP @ np.linalg.solve(PP, np.swapaxes(JP, 1, 2)), axis=0) / photos.sigma**2
    scale = 1 / np.sqrt(np.diag(F))
    return (np.linalg.inv(F * scale * scale[:, None]) * scale * scale[:, None])[:4, :4]
