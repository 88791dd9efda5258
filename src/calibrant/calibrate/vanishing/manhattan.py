"""Rotation of a camera from one picture of a scene whose edges have three orthogonal directions (Manhattan world).

    edges (sub-pixel points) -> great circles -> random sampling -> least squares on SO(3) -> R_camera_scene

The scene's axes are called x (right), y (down) and z (ahead) as they are nearest to the camera's; their origin is the
camera's centre, as a direction says nothing about a place.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.vanishing.circles import Circles, great_circles, point_noise, straight
from calibrant.calibrate.vanishing.fit import (
    Fit,
    camera_share,
    fit_directions,
    nearest_axes,
    rotation_covariance,
)
from calibrant.calibrate.vanishing.orthogonality import RightAngle, right_angles
from calibrant.calibrate.vanishing.search import FOCAL_GRID, GATE, chance_log10, scaled_normals, search, whitened
from calibrant.cameras import Camera
from calibrant.detection.line_segments import Segments
from calibrant.errors import InputError, RefusedError

Focal = Literal["known", "unknown"]

AXES = ("x", "y", "z")
FEWEST_EDGES = 4
"""Two directions of two edges each."""
BY_CHANCE = -3.0
"""log10 of how often chance may show a direction: once in a thousand pictures."""
FOCAL_WORST = 0.25
"""Relative sigma of the focal length above which it is not known: its logarithm is then no longer Gaussian."""
AT_INFINITY_DEG = 10.0
"""Angle to the image plane below which a vanishing point lies beyond 5.7 focal lengths."""


@dataclass(frozen=True, eq=False)
class Manhattan:
    """R_camera_scene (3, 3) with its covariance (3, 3), radians about the camera's axes.

    of_camera: the camera's share of the covariance, None where it states no uncertainty. camera: the one given, or with
    the focal length found, and sigma_focal its relative sigma (None where it was known). segments: the straight edges;
    member (m,): 0, 1, 2 for x, y, z, or -1. supported: which directions have more edges than chance would give.
    """

    R_camera_scene: Array
    covariance: Array
    of_camera: Array | None
    camera: Camera
    sigma_focal: float | None
    segments: Segments
    member: NDArray[np.int64]
    supported: tuple[bool, bool, bool]
    sigma_px: float
    excess_px: float
    angles: tuple[RightAngle, ...]


def manhattan_rotation(segments: Segments, camera: Camera, *, focal: Focal = "known") -> Manhattan:
    """The rotation between camera and scene; with focal="unknown" also the focal length, the camera's being a start.

    Args: segments of a picture (`detect.line_segments.find_segments`); camera of any central model; with an unknown
    focal length a pinhole, whose principal point and aspect are held.
    Raises: RefusedError for too few edges, fewer than two directions, a focal length that the directions do not show;
    InputError for a camera that does not suit.
    """
    if camera.model.projection == "parallel":
        raise InputError(f"a {camera.model.name} camera sees parallel edges as parallel: they vanish nowhere")
    if focal == "unknown" and camera.model.name != "pinhole":
        raise InputError(
            f"the focal length can be found of a pinhole camera, this one is {camera.model.name}: its distortion is "
            "known for its own focal length. Undistort the picture first, or use the focal length of the camera"
        )
    _refuse_few(len(segments))
    every = great_circles(camera.model, camera.values, segments)
    keep = straight(every)
    _refuse_few(int(keep.sum()))
    circles, segments = every.only(keep), segments.only(keep)
    sigma_px = point_noise(circles)
    grid = FOCAL_GRID if focal == "unknown" else np.ones(1)
    fit = fit_directions(circles, search(circles, sigma_px=sigma_px, focal=grid), sigma_px=sigma_px, focal=focal)
    supported = _supported(circles, fit)
    _refuse_directions(circles, fit, supported)
    covariance, sigma_focal = _certainty(fit, supported, focal)
    refit = _Refit(camera, segments)
    of_camera = None
    if focal == "known" and camera.covariance is not None:
        of_camera = camera_share(fit, circles, refit.circles, camera.values, camera.covariance)
        covariance = covariance + of_camera
    angles = right_angles(fit, circles, None if of_camera is None else refit.circles, camera)
    order = nearest_axes(fit.R_camera_scene)
    place = {int(abs(p)) - 1: i for i, p in enumerate(order)}
    named = np.array([place[m] if m >= 0 else -1 for m in fit.member.tolist()])
    return Manhattan(
        fit.R_camera_scene[:, np.abs(order) - 1] * np.sign(order),
        covariance,
        of_camera,
        camera if focal == "known" else _zoomed(camera, fit.focal, sigma_focal),
        None if focal == "known" else sigma_focal,
        segments,
        named,
        tuple(supported[abs(p) - 1] for p in order),
        sigma_px,
        fit.excess_px,
        tuple(a.renamed(place) for a in angles),
    )


@dataclass(frozen=True, eq=False)
class _Refit:
    """Great circles of the same edges through another lens."""

    camera: Camera
    segments: Segments

    def circles(self, values: Array) -> Circles:
        return great_circles(self.camera.model, values, self.segments)


def default_camera(image_size: tuple[int, int]) -> Camera:
    """The pinhole that stands for an unknown camera: square pixels, the axis at the image's middle."""
    width, height = image_size
    f = float(max(image_size))
    return Camera.create(
        "pinhole", {"fx": f, "fy": f, "cx": (width - 1) / 2, "cy": (height - 1) / 2}, image_size=image_size
    )


def vanishing_point(camera: Camera, direction: Array) -> Array | None:
    """Pixel (2,) where edges along a direction (3,) meet; None where the camera does not see it (both ways tried)."""
    for d in (direction, -direction):
        if camera.model.valid(camera.values, d):
            uv = camera.project(d)
            if np.all(np.isfinite(uv)):
                return uv
    return None


def _zoomed(camera: Camera, s: float, sigma: float) -> Camera:
    p = dict(camera.parameters)
    p["fx"], p["fy"] = s * p["fx"], s * p["fy"]
    covariance = np.zeros((4, 4))
    f = np.array([p["fx"], p["fy"]])
    covariance[:2, :2] = sigma**2 * np.outer(f, f)
    return Camera.create("pinhole", p, image_size=camera.image_size, covariance=covariance)


def _refuse_few(count: int) -> None:
    if count < FEWEST_EDGES:
        raise RefusedError(
            f"edges: {count} straight edges found, {FEWEST_EDGES} are needed and some dozens make it reliable; take a "
            "picture of a building, a room or a machine with straight edges, in focus"
        )


def _supported(circles: Circles, fit: Fit) -> list[bool]:
    """Which directions more edges follow than chance would let them."""
    m = len(circles)
    counts = [int(np.sum(fit.member == k)) for k in range(3)]
    _, unit = whitened(circles, fit.R_camera_scene.T, fit.focal)
    length = np.linalg.norm(scaled_normals(circles, fit.focal), axis=1)
    # A random plane's |n . d| is even over 0 .. 1.
    share = np.minimum(GATE * unit * fit.noise[:, None] / length[:, None], 1.0).mean(axis=0)
    out, left = [False] * 3, m
    for rank, k in enumerate(sorted(range(3), key=lambda k: -counts[k])):
        # The first direction is that of any two edges, the second that of one more, the third is then given.
        own, tests = ((2, 0.5 * m * m), (1, float(m)), (0, 1.0))[rank]
        chance = chance_log10(max(counts[k] - own, 0), max(left - own, 1), tests, float(share[k]))
        out[k] = counts[k] > own and chance < BY_CHANCE
        left -= counts[k]
    return out


def _refuse_directions(circles: Circles, fit: Fit, supported: list[bool]) -> None:
    if sum(supported) >= 2:
        return
    counts = sorted((int(np.sum(fit.member == k)) for k in range(3)), reverse=True)
    found = "one direction" if any(supported) else "no direction"
    raise RefusedError(
        f"directions: the {len(circles)} straight edges show {found} that is more than chance ({counts[0]}, "
        f"{counts[1]} and {counts[2]} of them follow the best three orthogonal ones); a rotation needs two. Take a "
        "picture that shows edges of two directions at right angles, several of each"
    )


def _certainty(fit: Fit, supported: list[bool], focal: Focal) -> tuple[Array, float]:
    """`rotation_covariance`, with a focal length that cannot be known refused by the name of what is missing."""
    try:
        covariance, sigma_focal = rotation_covariance(fit)
    except RefusedError:
        if focal == "known":
            raise
        covariance, sigma_focal = np.zeros((3, 3)), np.inf
    if focal == "unknown" and not sigma_focal < FOCAL_WORST:
        tilt = np.rad2deg(np.arcsin(np.clip(np.abs(fit.R_camera_scene[2]), 0, 1)))
        far = [t for t, ok in zip(tilt, supported) if ok and t < AT_INFINITY_DEG]
        cause = (
            f"{len(far)} of the {sum(supported)} directions found {'is' if len(far) == 1 else 'are'} parallel to the "
            f"image ({', '.join(f'{t:.1f}' for t in far)} deg off): the vanishing point is at infinity whatever the "
            "focal length"
            if far
            else "the directions found have too few edges for it"
        )
        known = "nothing" if not np.isfinite(sigma_focal) else f"{100 * sigma_focal:.0f} % (1 sigma)"
        raise RefusedError(
            f"focal length: {cause}; what is known of it is {known}. Turn the camera so that two directions run away "
            "from it, or give the focal length: --camera"
        )
    return covariance, sigma_focal
