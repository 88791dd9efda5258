"""What the camera photographs while a projector shows a sequence of patterns: light, shadow, blur, noise, 8 bits.

    I(u) = g / 2 rho(p) cos(angle) (d0 / d)^2 [ L_k(q) + global mean(L_k) ] + ambient,    p the point at u, q its pixel

in every part of a pixel (S x S samples), blurred by the camera's lens; L_k the pattern's light through the projector's
own blur and gamma.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Mask
from calibrant.geometry import se3
from calibrant.opencv import cv2
from calibrant.patterns.sequence import Pattern, PatternSequence
from calibrant.simulate.projector.points import ProjectorPair
from calibrant.simulate.projector.surfaces import Surface

FINE = 16
"""Steps a projector pixel in the table of its light."""
SHADOW_M = 1e-4


@dataclass(frozen=True, kw_only=True)
class Lighting:
    """How pictures are taken. white: grey level of a white surface, facing both at distance_m, in full light.

    noise: grey levels, of which sqrt(I) shot: sigma^2 = noise^2 + shot I; blur_px of the camera, projector_blur_px of
    the projector, sigmas; gamma: of the projector, 1 linear; indirect: light that comes by way of the rest, of the
    whole; scaling: (factor, offset) by which the projector resamples its picture, pixel by pixel the nearest one's.
    """

    white: float = 200.0
    distance_m: float = 0.8
    noise: float = 0.8
    shot: float = 0.01
    blur_px: float = 0.6
    projector_blur_px: float = 0.35
    gamma: float = 1.0
    ambient: float = 4.0
    indirect: float = 0.0
    scaling: tuple[float, float] = (1.0, 0.0)
    samples: int = 2


@dataclass(frozen=True, eq=False)
class Lit:
    """What every sample of the camera's picture sees: the projector's pixels (n, 2) and how brightly it is lit (n,)."""

    pixels: Array
    light: Array
    direct: Array
    size: tuple[int, int]


def photographed(
    pair: ProjectorPair, surface: Surface, sequence: PatternSequence, rng: np.random.Generator, lighting: Lighting
) -> Iterator[NDArray[np.uint8]]:
    """The camera's picture (h, w) of every pattern, in the sequence's order."""
    lit = lit_by(pair, surface, lighting)
    for pattern in sequence.patterns:
        yield _picture(lit, sequence, pattern, rng, lighting)


def lit_by(pair: ProjectorPair, surface: Surface, lighting: Lighting) -> Lit:
    """Where the light of every part of a camera's pixel comes from; points in shadow are lit by nothing."""
    (w, h), S = pair.camera.image_size, lighting.samples
    step = (np.arange(S) + 0.5) / S - 0.5
    u = (np.arange(w)[:, None] + step).ravel()
    v = (np.arange(h)[:, None] + step).ravel()
    uv = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    rays = pair.camera.unproject(uv)
    seen = surface.hit(np.zeros(3), rays)
    there = np.isfinite(seen.distance)
    p = np.where(there, seen.distance, 1.0)[:, None] * rays
    source = pair.T_camera_projector[:3, 3]
    away = p - source
    d = np.linalg.norm(away, axis=1)
    direct = there.copy()
    blocked = surface.hit(source, away / d[:, None]).distance
    direct &= blocked > d - SHADOW_M
    cosine = np.maximum(-np.sum(seen.normal * away, axis=1) / d, 0.0)
    light = np.where(there, seen.albedo / 0.8 * cosine * (lighting.distance_m / d) ** 2, 0.0)
    q = pair.projector.project(se3.apply(se3.inverse(pair.T_camera_projector), p))
    pw, ph = pair.projector.image_size
    far = np.abs(q - (np.array([pw, ph]) - 1) / 2) - np.array([pw, ph]) / 2
    inside: Mask = np.asarray(np.isfinite(q).all(axis=1) & (far <= 0).all(axis=1))
    q = np.where(inside[:, None], q, 0.0)
    return Lit(q, light * lighting.white, (direct & inside).astype(np.float64), (w, h))


def _picture(
    lit: Lit, sequence: PatternSequence, pattern: Pattern, rng: np.random.Generator, lighting: Lighting
) -> NDArray[np.uint8]:
    table, mean = _light_table(sequence, pattern, lighting)
    along = lit.pixels[:, 1 if pattern.axis == "y" else 0]
    at = np.clip(np.rint((along + 0.5) * FINE - 0.5).astype(np.int64), 0, len(table) - 1)
    L = (1 - lighting.indirect) * lit.direct * table[at] + lighting.indirect * mean
    (w, h), S = lit.size, lighting.samples
    picture = (lit.light * L).reshape(h, S, w, S).mean(axis=(1, 3)) + lighting.ambient
    if lighting.blur_px:
        picture = cv2.GaussianBlur(picture, (0, 0), lighting.blur_px, borderType=cv2.BORDER_REPLICATE)
    sigma = np.sqrt(lighting.noise**2 + lighting.shot * np.maximum(picture, 0.0))
    return np.clip(np.rint(picture + sigma * rng.normal(size=picture.shape)), 0, 255).astype(np.uint8)


def _light_table(sequence: PatternSequence, pattern: Pattern, lighting: Lighting) -> tuple[Array, float]:
    """The projector's light along the pattern's axis, FINE steps a pixel, and its mean."""
    level = sequence.level(pattern)
    if not pattern.axis:
        level = np.full(sequence.projector_size[0], level[0])
    factor, offset = lighting.scaling
    if (factor, offset) != (1.0, 0.0):
        level = level[np.clip(np.floor(np.arange(len(level)) * factor + offset).astype(np.int64), 0, len(level) - 1)]
    light = (np.rint(255 * level) / 255) ** lighting.gamma
    fine = np.repeat(light, FINE)
    if lighting.projector_blur_px:
        reach = int(4 * lighting.projector_blur_px * FINE)
        bell = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (lighting.projector_blur_px * FINE)) ** 2)
        fine = np.convolve(np.pad(fine, reach, mode="edge"), bell / bell.sum(), mode="valid")
    return fine, float(light.mean())
