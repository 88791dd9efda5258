"""Photographs of a flat target, computed: what a camera of any model sees of a sheet at a known place.

A pixel is the mean of the scene over its square. The ray of each pixel meets the sheet's plane at (X, Y); the map
pixel -> (X, Y) is linear within a pixel (its curvature moves an edge by under 0.001 px), so a pixel that an edge may
cross takes the mean of the drawing at 64 points of its footprint, and any other pixel takes one. Then come the lens
(Gaussian blur), the light, the sensor's noise and the rounding to 8 bits.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import RectBivariateSpline

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.opencv import cv2
from calibrant.simulate.background import clutter
from calibrant.simulate.texture import Texture, rasterise
from calibrant.targets import Artwork

_NODE_STEP_PX = 8
"""Rays are computed at every 8th pixel; a cubic spline between them is true to 1e-4 px for lenses that project to
an image at all (the error falls with the fourth power of step / focal length)."""

_SAMPLES = 64
"""Points a pixel on edges. The pattern has 64 different x and 64 different y: coverage is exact to 1/128."""


@dataclass(frozen=True)
class Look:
    """How the picture is taken. Greys are 0..255.

    blur_px: sigma of the lens blur; motion_px: how far the picture moves along u and v while it is exposed, evenly, the
    pose being that of mid-exposure; noise_grey: sigma of the sensor's noise; paper_grey, ink_grey: full light;
    uneven_light: relative fall of the light across the image; vignetting: relative fall towards the image's corners;
    clutter: number of sharp shapes behind the board, 0 for a plain middle grey.
    """

    blur_px: float = 0.8
    motion_px: tuple[float, float] = (0.0, 0.0)
    noise_grey: float = 4.0
    paper_grey: float = 235.0
    ink_grey: float = 25.0
    uneven_light: float = 0.25
    vignetting: float = 0.2
    clutter: int = 60

    def __post_init__(self) -> None:
        if min(self.blur_px, self.noise_grey, self.clutter) < 0:
            raise InputError(f"blur_px, noise_grey and clutter must be at least 0, got {self}")
        if not (0 <= self.uneven_light < 1 and 0 <= self.vignetting < 1):
            raise InputError(f"uneven_light and vignetting are parts of the light, 0 to below 1, got {self}")


IDEAL = Look(blur_px=0.0, noise_grey=0.0, paper_grey=215.0, ink_grey=25.0, uneven_light=0.0, vignetting=0.0, clutter=0)
"""A perfect lens, light and sensor: only pixels and 8 bits remain."""


def render(
    artwork: Artwork,
    camera: Camera,
    T_camera_target: ArrayLike,
    *,
    rng: np.random.Generator,
    look: Look | None = None,
) -> NDArray[np.uint8]:
    """The image of a target.

    Args: artwork, in the target's frame, metres; T_camera_target (4, 4); rng: source of clutter, light and noise.
    Returns (height, width) uint8. A sheet seen from behind, or out of view, leaves the background alone.
    Raises: InputError when the pose is not a rigid transform.
    """
    how = look or Look()
    T = se3.check(T_camera_target, name="T_camera_target")
    width, height = camera.image_size
    if how.clutter:
        scene = clutter(camera.image_size, shapes=how.clutter, rng=rng)
    else:
        scene = np.full((height, width), 0.5, dtype=np.float32)
    rows, columns = sheet_window(artwork, camera, T)
    if rows.stop > rows.start and columns.stop > columns.start:
        grey, cover = _sheet(rasterise(artwork), pixel_rays(camera)[rows, columns], T)
        scene[rows, columns] = scene[rows, columns] * (1 - cover) + grey
    image = (how.ink_grey + (how.paper_grey - how.ink_grey) * scene) * _light(camera.image_size, how, rng)
    if how.blur_px > 0:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), how.blur_px), dtype=np.float32)
    if any(how.motion_px):
        image = _moved(image, how.motion_px)
    if how.noise_grey > 0:
        image = image + np.float32(how.noise_grey) * rng.standard_normal(image.shape, dtype=np.float32)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


@lru_cache(maxsize=2)
def pixel_rays(camera: Camera) -> Array:
    """Unit rays of all pixel centres, (height, width, 3), camera frame; NaN where the camera sees nothing."""
    width, height = camera.image_size
    nodes = [np.linspace(0, n - 1, max(4, n // _NODE_STEP_PX + 2)) for n in (width, height)]
    rays = camera.unproject(np.stack(np.meshgrid(*nodes), axis=-1))
    if not np.all(np.isfinite(rays)):
        # A spline would carry the rim of the lens's field into good pixels.
        every = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
        return camera.unproject(every.astype(np.float64))
    splines = [RectBivariateSpline(nodes[1], nodes[0], rays[..., k]) for k in range(3)]
    return np.stack([s(np.arange(height), np.arange(width)) for s in splines], axis=-1)


def sheet_window(artwork: Artwork, camera: Camera, T_camera_target: Array) -> tuple[slice, slice]:
    """Rows and columns that hold the sheet: the box around its projected rim, or all when the rim leaves view."""
    x0, y0, x1, y1 = artwork.bounds
    along = np.linspace(0, 1, 65)  # points a side: a bent side stays within the margin between two of them
    xs, ys = x0 + (x1 - x0) * along, y0 + (y1 - y0) * along
    rim = np.concatenate(
        [
            np.stack([np.concatenate([xs, xs]), np.repeat([y0, y1], 65)], axis=-1),
            np.stack([np.repeat([x0, x1], 65), np.concatenate([ys, ys])], axis=-1),
        ]
    )
    points = np.concatenate([rim, np.zeros((len(rim), 1))], axis=-1)
    width, height = camera.image_size
    uv = camera.project(se3.apply(T_camera_target, points))
    if not np.all(np.isfinite(uv)) or np.any(np.abs(uv) > 2 * max(width, height)):
        return slice(0, height), slice(0, width)
    margin = 4
    c0, r0 = np.clip(np.floor(uv.min(axis=0)).astype(int) - margin, 0, (width, height))
    c1, r1 = np.clip(np.ceil(uv.max(axis=0)).astype(int) + margin, 0, (width, height))
    return slice(int(r0), int(r1)), slice(int(c0), int(c1))


def _sheet(texture: Texture, rays: Array, T_camera_target: Array) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Grey times cover, and cover, of every pixel of a window: two (h, w) images, 0..1.

    p_target = R^T (s ray - t) has z = 0 at s = (n . t) / (n . ray), n = R e_z; the face is seen where both are > 0.
    """
    R, t = T_camera_target[:3, :3], T_camera_target[:3, 3]
    local = rays @ R
    origin = t @ R
    seen = (local[..., 2] > 1e-6) & (origin[2] > 0)
    s = origin[2] / np.where(seen, local[..., 2], np.nan)
    xy = (s[..., None] * local[..., :2] - origin[:2] - texture.origin) / texture.texel - 0.5  # texel centres are whole
    du = np.gradient(xy, axis=1) if xy.shape[1] > 1 else np.zeros_like(xy)
    dv = np.gradient(xy, axis=0) if xy.shape[0] > 1 else np.zeros_like(xy)
    height, width = texture.data.shape[:2]
    reach = 0.5 * (np.hypot(du[..., 0], du[..., 1]) + np.hypot(dv[..., 0], dv[..., 1]))
    with np.errstate(invalid="ignore"):
        inside = (xy > -1 - reach[..., None]) & (xy < np.array([width, height]) + reach[..., None])
    near = inside[..., 0] & inside[..., 1]
    cell = np.where(near[..., None], xy, -1e4).astype(np.float32)  # far off the sheet: cover 0
    clear = _look_up(texture.clearance, cell, cv2.INTER_NEAREST)
    edge = near & (clear < reach)
    image = _look_up(texture.data, cell, cv2.INTER_NEAREST).astype(np.float32) / np.float32(255)
    if np.any(edge):
        image[edge] = _footprint_means(texture, xy[edge], du[edge], dv[edge])
    return image[..., 0], image[..., 1]


def _footprint_means(texture: Texture, centre: Array, du: Array, dv: Array) -> NDArray[np.float32]:
    """Mean of the drawing over centre + a du + b dv, |a|, |b| <= 1/2: three (n, 2), texels -> (n, 2)."""
    a, b = _pattern()
    count = len(centre)
    columns = 1024  # the picture library takes images below 32768 on a side: fold the list
    folded = -(-count // columns) * columns
    total = np.zeros((folded, 2), dtype=np.float32)
    c, u, v = (np.resize(m.astype(np.float32), (folded, 2)) for m in (centre, du, dv))
    for i in range(_SAMPLES):
        at = (c + a[i] * u + b[i] * v).reshape(-1, columns, 2)
        total += _look_up(texture.data, at, cv2.INTER_LINEAR).reshape(-1, 2)
    return total[:count] / np.float32(255 * _SAMPLES)


def _look_up(picture: NDArray, at: NDArray[np.float32], interpolation: int) -> NDArray:
    """Values of a picture at texel coordinates (h, w, 2), 0 outside: (h, w) or (h, w, channels)."""
    # Two maps: given one of two channels, OpenCV 5.0.0 looks up the nearest pixel at other places than asked for.
    u, v = np.ascontiguousarray(at[..., 0]), np.ascontiguousarray(at[..., 1])
    return np.asarray(cv2.remap(picture, u, v, interpolation, borderMode=cv2.BORDER_CONSTANT))


@lru_cache(maxsize=1)
def _pattern() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Hammersley's points in the square [-1/2, 1/2]^2: k / n beside the bits of k in reverse."""
    k = np.arange(_SAMPLES)
    bits = _SAMPLES.bit_length() - 1
    reverse = sum(((k >> i) & 1) << (bits - 1 - i) for i in range(bits))
    a, b = ((np.asarray(m) + 0.5) / _SAMPLES - 0.5 for m in (k, reverse))
    return a.astype(np.float32), b.astype(np.float32)


def _moved(image: NDArray[np.float32], motion_px: tuple[float, float]) -> NDArray[np.float32]:
    """The mean of a picture shifted along a line, -1/2 to 1/2 of the motion: its spectrum times sinc(f . motion)."""
    pad = int(np.ceil(max(map(abs, motion_px)))) + 8  # the spectrum is that of a picture repeated on all sides
    padded = np.pad(image, pad, mode="reflect")
    f_u, f_v = np.fft.rfftfreq(padded.shape[1]), np.fft.fftfreq(padded.shape[0])
    spectrum = np.fft.rfft2(padded) * np.sinc(f_u * motion_px[0] + f_v[:, None] * motion_px[1])
    inside = np.fft.irfft2(spectrum, padded.shape)[pad:-pad, pad:-pad]
    return np.ascontiguousarray(inside, dtype=np.float32)


def _light(image_size: tuple[int, int], look: Look, rng: np.random.Generator) -> NDArray[np.float32]:
    """Relative light (h, w): 1 - uneven * ramp in a random direction, times 1 - vignetting * (r / r_corner)^2."""
    width, height = image_size
    turn = rng.uniform(0, 2 * np.pi)
    x = np.linspace(-1, 1, width, dtype=np.float32)[None, :]
    y = np.linspace(-1, 1, height, dtype=np.float32)[:, None]
    ramp = 0.5 + 0.5 * (np.float32(np.cos(turn)) * x + np.float32(np.sin(turn)) * y) / np.float32(np.sqrt(2))
    fall = 1 - np.float32(look.vignetting) * (x**2 + y**2) / 2
    return np.asarray((1 - np.float32(look.uneven_light) * ramp) * fall, dtype=np.float32)
