"""What goes wrong with boards, lenses and photos. Each changes a set of photos in place, before it is taken.

`photos.truths` are the cameras a person would call right. Where photos are of two lenses (mixed, zoomed, cropped) that
is either of them, and a result is wrong if it is wrong for both.
"""

from __future__ import annotations

import numpy as np

from users.photos import Photos
from users.rigid import Array

Rng = np.random.Generator


def second(photos: Photos) -> Array:
    """Every second view (v,)."""
    return np.arange(len(photos)) % 2 == 1


# Boards


def dots_off(mm: float):
    """Every dot printed somewhere else, the same in all views."""

    def edit(photos: Photos) -> None:
        off = photos.rng.standard_normal(photos.told.shape) * [1, 1, 0]
        photos.real = photos.real + 1e-3 * mm * off

    return edit


def one_dot_off(mm: float):
    """One dot or corner is printed (or found, in its surroundings) somewhere else in all views."""

    def edit(photos: Photos) -> None:
        off, angle = np.zeros_like(photos.told), photos.rng.uniform(0, 2 * np.pi)
        off[photos.rng.integers(len(off))] = 1e-3 * mm * np.array([np.cos(angle), np.sin(angle), 0])
        photos.real = photos.real + off

    return edit


def taller(share: float):
    """Squares that are rectangles: the board is longer along y than said."""

    def edit(photos: Photos) -> None:
        photos.real = photos.real * [1, 1 + share, 1]

    return edit


def bent(mm: float):
    """Paper or board curled about a line of some direction: the middle lies `mm` off the ends."""

    def edit(photos: Photos) -> None:
        angle = photos.rng.uniform(0, np.pi)
        along = photos.shape() @ [np.cos(angle), np.sin(angle)]
        sign = photos.rng.choice([-1, 1])
        photos.real = photos.real + np.outer(1e-3 * sign * mm * (1 - (along / np.abs(along).max()) ** 2), [0, 0, 1])

    return edit


def twisted(mm: float):
    """Opposite corners up, the others down, by `mm`."""

    def edit(photos: Photos) -> None:
        x, y = photos.shape().T
        photos.real = photos.real + np.outer(1e-3 * mm * x * y, [0, 0, 1])

    return edit


def skewed_print(share: float):
    """A printer whose paper runs askew: x grows with y."""

    def edit(photos: Photos) -> None:
        photos.real = photos.real + np.outer(share * photos.real[:, 1], [1, 0, 0])

    return edit


def wobbling(mm: float):
    """Paper held by hand: bent anew in every view, as a cylinder of random direction, sag of `mm` rms."""

    def edit(photos: Photos) -> None:
        v = len(photos)
        angle = photos.rng.uniform(0, np.pi, v)
        along = np.stack([np.cos(angle), np.sin(angle)], 1) @ photos.shape().T
        sag = 1e-3 * mm * photos.rng.standard_normal((v, 1)) * (1 - along**2)
        real = np.broadcast_to(photos.real, (v, *photos.told.shape)).copy()
        real[..., 2] += sag
        photos.real = real

    return edit


def larger_board(share: float):
    """The board is said to be larger than it is."""

    def edit(photos: Photos) -> None:
        photos.told = photos.told * (1 + share)

    return edit


# Pixels


def shared_noise(shift: float, affine: float):
    """Points of a view err alike: by a shift, and a linear map that moves the board's edges, in sigmas, beside the
    white noise."""

    def edit(photos: Photos) -> None:
        v, shape, rng = len(photos), photos.shape(), photos.rng
        linear = np.einsum("vij,nj->vni", rng.standard_normal((v, 2, 2)), shape)
        alike = photos.sigma * (shift * rng.standard_normal((v, 1, 2)) + affine * linear)
        photos.after.append(lambda uv: uv + alike)

    return edit


def smooth_noise(level: float):
    """Points of a view err alike by a smooth wave over the board (lighting, a detector's bias), in sigmas."""

    def edit(photos: Photos) -> None:
        v, shape, rng = len(photos), photos.shape(), photos.rng
        wave = rng.normal(0, 2.0, (v, 2, 2))
        phase = np.einsum("vij,nj->vni", wave, shape) + rng.uniform(0, 2 * np.pi, (v, 1, 2))
        alike = photos.sigma * level * np.sqrt(2) * np.sin(phase)
        photos.after.append(lambda uv: uv + alike)

    return edit


def heavy_tails(photos: Photos) -> None:
    """Student's t with 3 degrees of freedom, of the same standard deviation."""
    photos.noise = lambda p: p.sigma * p.rng.standard_t(3, (len(p), len(p.told), 2)) / np.sqrt(3)


def motion_blur(most: float):
    """Every view's noise is up to `most` times as large along one direction, that of its motion."""

    def noise(photos: Photos) -> Array:
        v, rng = len(photos), photos.rng
        angle = rng.uniform(0, np.pi, (v, 1))
        along = rng.standard_normal((v, len(photos.told))) * rng.uniform(1, most, (v, 1))
        across = rng.standard_normal((v, len(photos.told)))
        u, w = (np.cos(angle) * along - np.sin(angle) * across, np.sin(angle) * along + np.cos(angle) * across)
        return photos.sigma * np.stack([u, w], axis=-1)

    def edit(photos: Photos) -> None:
        photos.noise = noise

    return edit


def unequal_blur(photos: Photos) -> None:
    """Views of other sharpness: noise of a third to three times the level."""
    photos.noise = lambda p: (
        p.sigma * np.exp(p.rng.uniform(-1.1, 1.1, (len(p), 1, 1))) * p.rng.standard_normal((len(p), len(p.told), 2))
    )


def outliers(share: float):
    """A share of the points lies 3 to 20 px off."""

    def edit(photos: Photos) -> None:
        def change(uv: Array) -> Array:
            bad = photos.rng.random(uv.shape[:2]) < share
            angle = photos.rng.uniform(0, 2 * np.pi, uv.shape[:2])
            far = np.where(bad, photos.rng.uniform(3, 20, uv.shape[:2]), 0)
            return uv + far[..., None] * np.stack([np.cos(angle), np.sin(angle)], -1)

        photos.after.append(change)

    return edit


def half_hidden(photos: Photos) -> None:
    """A part of every board is out of the picture or covered, as with ChArUco boards."""
    v, shape = len(photos), photos.shape()
    angle = photos.rng.uniform(0, 2 * np.pi, v)
    along = np.stack([np.cos(angle), np.sin(angle)], 1) @ shape.T
    photos.keep = along > photos.rng.uniform(-1.2, -0.2, (v, 1))


def misnumbered(photos: Photos) -> None:
    """One view is numbered from the next column on, as a covered ChArUco board may be: no lens knows, a robot does."""
    square = np.diff(np.unique(photos.told[:, 0].round(9)))[0]
    k = len(photos) // 2
    photos.T = photos.T.copy()
    photos.T[k, :3, 3] += photos.T[k, :3, 0] * square


# Lenses that are not one lens


def another_lens(which: Array, K: Array, photos: Photos) -> None:
    photos.K = np.where(which[:, None], K, photos.K)


def enlarged(share: float, *, which: str = "second"):
    """Views enlarged about the image's centre: a zoom, or a copy scaled and cut. which: "second", "half" (from half
    way on), "one"."""

    def edit(photos: Photos) -> None:
        chosen = second(photos) if which == "second" else np.arange(len(photos)) >= len(photos) // 2
        if which == "one":
            chosen = np.arange(len(photos)) == len(photos) // 3
        f, c = photos.K[0, :2] * (1 + share), photos.middle + (1 + share) * (photos.K[0, 2:] - photos.middle)
        another_lens(chosen, np.concatenate([f, c]), photos)
        if which != "one":
            photos.truths.append(np.concatenate([f, c]))

    return edit


def refocused(share: float, *, drift: bool = False):
    """The lens breathes about its own axis: another focal length from half way on, or drifting over all views."""

    def edit(photos: Photos) -> None:
        v = len(photos)
        grown = 1 + share * (np.linspace(-0.5, 0.5, v) if drift else (np.arange(v) >= v // 2))
        photos.K = photos.K * np.stack([grown, grown, np.ones(v), np.ones(v)], 1)
        photos.truths = [photos.K[0].copy(), photos.K[-1].copy()] + ([photos.truths[0]] if drift else [])

    return edit


def two_cameras(photos: Photos) -> None:
    """Left and right photos in one folder: one make, focal lengths 1 % and centres 1.5 % of the width apart."""
    rng, w = photos.rng, photos.size[0]
    other = photos.K[0] * [1 + 0.01 * rng.standard_normal(), 1, 1, 1]
    other[1] = other[0] * photos.K[0, 1] / photos.K[0, 0]
    other[2:] += 0.015 * w * rng.standard_normal(2)
    which = np.arange(len(photos)) >= (len(photos) + 1) // 2
    photos.K = np.where(which[:, None], other, photos.K)
    photos.D = photos.D + np.outer(which * 0.01 * rng.standard_normal(), [1, 0, 0, 0, 0])
    photos.truths.append(other)


def cropped(x: float, y: float):
    """Every second view cut out elsewhere of the sensor: the centre is moved by shares of the width and height."""

    def edit(photos: Photos) -> None:
        other = photos.K[0] - [0, 0, x * photos.size[0], y * photos.size[1]]
        another_lens(second(photos), other, photos)
        photos.truths.append(other)

    return edit


def mirrored(photos: Photos) -> None:
    """Every second view left for right, and the board numbered as a detector sees it then: from the other side."""
    w = photos.size[0]
    which = second(photos)
    order = np.lexsort((-photos.told[:, 0].round(9), photos.told[:, 1].round(9)))

    def change(uv: Array) -> Array:
        other = (uv * [-1, 1] + [w - 1, 0])[:, order]
        return np.where(which[:, None, None], other, uv)

    photos.after.append(change)
    photos.truths.append(photos.K[0] * [1, 1, -1, 1] + [0, 0, w - 1, 0])


def turned_half(photos: Photos) -> None:
    """Every second view turned by half a turn (a phone's orientation flag), which numbers boards from either end."""
    which, size = second(photos), np.array(photos.size)
    photos.after.append(lambda uv: np.where(which[:, None, None], size - 1 - uv, uv))
    photos.truths.append(np.concatenate([photos.K[0, :2], size - 1 - photos.K[0, 2:]]))


def rescaled(share: float):
    """Every second view from another mode of the sensor, scaled to the same size: its height is stretched."""

    def edit(photos: Photos) -> None:
        which, h = second(photos), photos.size[1]
        photos.after.append(
            lambda uv: np.where(which[:, None, None], uv * [1, 1 + share] - [0, share * (h - 1) / 2], uv)
        )
        K = photos.K[0]
        photos.truths.append(np.array([K[0], K[1] * (1 + share), K[2], K[3] * (1 + share) - share * (h - 1) / 2]))

    return edit


def halved(photos: Photos) -> None:
    """Every second view taken at half the resolution and scaled up again: the same camera, with twice the noise."""
    which = second(photos)
    white = photos.sigma * np.where(which[:, None, None], 2.0, 1.0)
    photos.noise = lambda p: white * p.rng.standard_normal((len(p), len(p.told), 2))


def stretched_all(share: float):
    """Pixels that are not square: all pictures stretched in height (another aspect of the video, resized)."""

    def edit(photos: Photos) -> None:
        photos.K = photos.K * [1, 1 + share, 1, 1 + share]
        photos.truths = [photos.K[0].copy()]

    return edit


# Shutters


def rolling_shutter(px: float):
    """Rows are read one after the other while the board moves: `px` pixels a frame (rms), another way in each view."""

    def edit(photos: Photos) -> None:
        angle = photos.rng.uniform(0, 2 * np.pi, (len(photos), 1, 1))
        way = px * np.concatenate([np.cos(angle), np.sin(angle)], -1) * photos.rng.uniform(0, np.sqrt(3), angle.shape)
        h = photos.size[1]
        photos.after.append(lambda uv: uv + way * (uv[..., 1:] / h - 0.5))

    return edit


def belt_shutter(px: float):
    """The same with one motion for all views (a belt, a cart): the picture is sheared."""

    def edit(photos: Photos) -> None:
        h = photos.size[1]
        photos.after.append(lambda uv: uv + np.array([px, 0.0]) * (uv[..., 1:] / h - 0.5))

    return edit


def sheared(share: float):
    """u grows with v by a share: a shutter over a steady motion, or a scanner."""

    def edit(photos: Photos) -> None:
        cy = photos.K[0, 3]
        photos.after.append(lambda uv: uv + share * (uv[..., 1:] - cy) * [1.0, 0.0])

    return edit
