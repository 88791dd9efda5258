"""Epipolar geometry from matches: the fundamental matrix of two pictures, and of calibrated cameras the relative pose.

F and the start of the pose are OpenCV's robust estimates (USAC, MAGSAC++: Barath and others 2020; five points: Nister
2004). The pose is refined on the matches that fit, with rays r of any lens and t of length 1,

    min over R, t of sum e_i^2 / var(e_i),    e = r_b^T E r_a,    E = [t]x R,
    var(e) = sigma^2 (|J_b^T E r_a|^2 + |J_a^T E^T r_b|^2),

J = dr / d(u, v), Sampson's distance (Hartley and Zisserman, 11.4.3), and Cov = (J^T J)^-1 over the three turns and the
two directions of t. Pictures tell no length: t is in units of the baseline.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array, Mask
from calibrant.cameras import Camera
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import projective, se3, so3
from calibrant.opencv import cv2
from calibrant.optimize.uncertainty import of_inverse

FAR = 3.0
"""Sigmas of its distance from the line from which a match is wrong: of right ones, one in 400 is left out."""
LEAST_MATCHES = 8
_LEAST_POSE = 6
"""Five matches make poses, a sixth tells which."""
_STEPS = 30
_SETTLED = 1e-12
_PIXEL = 1e-3
"""Step of the derivative of rays by pixels."""
LOST_DEG = 30.0
"""1 sigma of the direction of t from which nothing is known of it."""
_ONE_PLACE = 1.5
"""Times the noise that a turn alone leaves of the matches: below, nothing shows that the second camera stands
elsewhere, and what looks like a direction is that of the noise."""
_SHARE = 0.25
"""Part of the matches that must fit: of wrong ones a thousand poses tried find some six that agree."""


@dataclass(frozen=True, eq=False)
class Fundamental:
    """F (3, 3) with u_b^T F u_a = 0, Frobenius norm 1; fitting (n,): which matches it holds for; rms_px: of their
    Sampson distances."""

    F: Array
    fitting: Mask
    rms_px: float


@dataclass(frozen=True, eq=False)
class RelativePose:
    """T_a_b (4, 4), |t| = 1: camera b in the frame of camera a, with its covariance (6, 6) in `se3.retract`'s chart.

    Radians and parts of the baseline, singular along t; fitting (n,); sigma_px: noise of a pixel per axis, from the
    residuals.
    """

    T_a_b: Array
    covariance: Array
    fitting: Mask
    sigma_px: float

    @property
    def E(self) -> Array:
        """(3, 3) with r_b^T E r_a = 0."""
        return projective.essential_from_transform(se3.inverse(self.T_a_b))


def fundamental_from_matches(uv_a: ArrayLike, uv_b: ArrayLike, *, sigma_px: float = 0.5) -> Fundamental:
    """F of matches (n, 2) each, n >= 8, wrong ones among them.

    Args: sigma_px: noise of a right match per axis. Raises: InputError for shapes, NaN, too few; RefusedError where no
    eight of them agree, or a homography holds for them as well: any F = [e]x H is then as good (H&Z, 13.6).
    """
    a, b = _checked(uv_a, uv_b, LEAST_MATCHES)
    cv2.setRNGSeed(0)
    F, kept = cv2.findFundamentalMat(a, b, cv2.USAC_MAGSAC, FAR * sigma_px, 0.9999, 10_000)
    if F is None or np.shape(F) != (3, 3):
        raise RefusedError(f"no fundamental matrix holds for eight of the {len(a)} matches; they may be wrong")
    fitting = np.asarray(kept).ravel() > 0
    if fitting.sum() < LEAST_MATCHES:
        raise RefusedError(f"a fundamental matrix holds for {int(fitting.sum())} of {len(a)} matches; expected eight")
    unit: Array = np.asarray(F, dtype=np.float64) / float(np.linalg.norm(F))
    distance = projective.sampson_distance(unit, a[fitting], b[fitting])
    _refuse_flat(a[fitting], b[fitting], distance)
    return Fundamental(unit, fitting, float(np.sqrt(np.mean(distance**2))))


def _refuse_flat(a: Array, b: Array, distance: Array) -> None:
    """Raises: RefusedError where a homography leaves of the matches what noise does, by the 95 % of either.

    Of noise sigma per axis in both pictures F leaves distances of sigma along a line, H of sqrt(2) sigma along two axes
    (where it keeps the scale).
    """
    H, _ = cv2.findHomography(a, b, cv2.USAC_MAGSAC, 1.0)
    if H is None:
        return
    off = np.linalg.norm(projective.apply_homography(H, a) - b, axis=1)
    by_plane = float(np.quantile(off, 0.95)) / (2.448 * np.sqrt(2))
    by_lines = float(np.quantile(distance, 0.95)) / 1.960
    if by_plane <= max(_ONE_PLACE * by_lines, 1e-6):
        raise RefusedError(
            f"one homography holds for the matches, to {by_plane:.2g} px (1 sigma): the camera stood still or only "
            "turned, or what it saw is flat, and many fundamental matrices would do; move the camera, and show things "
            "at different distances. For something flat give the cameras, which tell the pose then"
        )


def relative_pose(
    cameras: Sequence[Camera], uv_a: ArrayLike, uv_b: ArrayLike, *, sigma_px: float = 0.5
) -> RelativePose:
    """Where camera b stands from camera a, from matches (n, 2) each, n >= 6, wrong ones among them.

    Args: cameras: a and b; sigma_px: noise of a right match per axis, by which wrong ones are told.
    Raises: InputError for shapes, NaN, too few; RefusedError where the matches agree on no pose, or leave the direction
    of b open.

    >>> import numpy as np
    >>> from calibrant.cameras import Camera
    >>> from calibrant.perceive.stereo.epipolar import relative_pose
    >>> lens = {"fx": 800.0, "fy": 800.0, "cx": 319.5, "cy": 239.5}
    >>> camera = Camera.create("pinhole", lens, image_size=(640, 480))
    >>> points = np.random.default_rng(1).uniform([-0.5, -0.4, 1], [0.5, 0.4, 2], (30, 3))
    >>> pose = relative_pose((camera, camera), camera.project(points), camera.project(points - [0.1, 0, 0]))
    >>> pose.T_a_b[:3, 3].round(6).tolist()
    [1.0, 0.0, 0.0]
    """
    a, b = _checked(uv_a, uv_b, _LEAST_POSE)
    if len(cameras) != 2:
        raise InputError(f"a relative pose is that of two cameras, got {len(cameras)}")
    rays = [camera.unproject(uv) for camera, uv in zip(cameras, (a, b))]
    ahead = np.all([r[:, 2] > 0 for r in rays], axis=0)
    if ahead.sum() < _LEAST_POSE:
        raise InputError(f"{int(ahead.sum())} matches have rays ahead of both cameras; expected {_LEAST_POSE}")
    T = _start(cameras, [r[ahead] for r in rays], sigma_px)
    slopes = [_slopes(camera, uv) for camera, uv in zip(cameras, (a, b))]
    fitting = np.zeros(len(a), dtype=np.bool_)
    for _ in range(_STEPS):
        r, _ = _errors(T, rays, slopes)
        with np.errstate(invalid="ignore"):
            now = np.asarray(np.abs(r) <= FAR * sigma_px)
        if now.sum() < max(_LEAST_POSE, _SHARE * len(a)):
            raise RefusedError(f"the matches agree on no pose: {int(now.sum())} of {len(a)} fit the best one")
        T, settled = _refined(T, [x[now] for x in rays], [s[now] for s in slopes])
        if settled and np.array_equal(now, fitting):
            break
        fitting = now
    r, J = _errors(T, [x[fitting] for x in rays], [s[fitting] for s in slopes])
    spare = int(fitting.sum()) - 5
    sigma = max(float(np.sqrt(r @ r / spare)), 1e-9) if spare > 0 else sigma_px
    _refuse_one_place([x[fitting] for x in rays], [s[fitting] for s in slopes], sigma)
    return RelativePose(*_as_a_b(T, J, sigma), fitting, sigma)


def sampson_px(cameras: Sequence[Camera], T_a_b: ArrayLike, uv_a: ArrayLike, uv_b: ArrayLike) -> Array:
    """Sampson's distances (n,) of matches from a known pose of two cameras, pixels with their sign; NaN without a ray.

    Args: T_a_b (4, 4), camera b in the frame of a, any unit; uv_a, uv_b (n, 2). Raises: InputError for shapes, NaN.
    """
    a, b = _checked(uv_a, uv_b, 1)
    T = se3.inverse(T_a_b)
    T[:3, 3] /= np.linalg.norm(T[:3, 3])
    rays = [camera.unproject(uv) for camera, uv in zip(cameras, (a, b))]
    return _errors(T, rays, [_slopes(camera, uv) for camera, uv in zip(cameras, (a, b))])[0]


def _checked(uv_a: ArrayLike, uv_b: ArrayLike, least: int) -> tuple[Array, Array]:
    a, b = np.asarray(uv_a, dtype=np.float64), np.asarray(uv_b, dtype=np.float64)
    if a.ndim != 2 or a.shape[1:] != (2,) or a.shape != b.shape:
        raise InputError(f"matches are pixels (n, 2) of both pictures, as many of each, got {a.shape} and {b.shape}")
    if len(a) < least:
        raise InputError(f"{len(a)} matches; at least {least} are needed")
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise InputError("the matches hold NaN or infinite pixels; leave them out")
    return a, b


def _start(cameras: Sequence[Camera], rays: Sequence[Array], sigma_px: float) -> Array:
    """T_b_a by five points, the side on which most matches lie ahead of both."""
    xy = [r[:, :2] / r[:, 2:] for r in rays]
    # Pixels of a camera of focal length 1000, so that OpenCV's limits mean what they do in pixels.
    f = float(np.mean([c.parameters["fx"] for c in cameras]))
    K = np.diag([f, f, 1.0])
    cv2.setRNGSeed(0)
    E, kept = cv2.findEssentialMat(f * xy[0], f * xy[1], K, cv2.USAC_MAGSAC, 0.9999, FAR * sigma_px)
    if E is None or np.shape(E)[0] < 3:
        raise RefusedError(f"no pose of two cameras holds for five of the {len(xy[0])} matches; they may be wrong")
    _, R, t, _ = cv2.recoverPose(np.asarray(E)[:3], f * xy[0], f * xy[1], K, mask=np.asarray(kept).copy())
    return se3.make(R, np.asarray(t).ravel())


def _slopes(camera: Camera, uv: Array) -> Array:
    """d ray / d pixel (n, 3, 2)."""
    steps = [(camera.unproject(uv + _PIXEL * e) - camera.unproject(uv - _PIXEL * e)) / (2 * _PIXEL) for e in np.eye(2)]
    return np.stack(steps, axis=2)


def _errors(T_b_a: Array, rays: Sequence[Array], slopes: Sequence[Array]) -> tuple[Array, Array]:
    """Sampson distances (n,), pixels, and their derivative (n, 5) by the turns and the directions of t, the change of
    the denominator left out: it is of second order where the distances are small."""
    R, t = T_b_a[:3, :3], T_b_a[:3, 3]
    p = rays[0] @ R.T
    E = so3.hat(t) @ R
    e = np.einsum("ni,ij,nj->n", rays[1], E, rays[0])
    of_b = np.einsum("nik,ni->nk", slopes[1], rays[0] @ E.T)
    of_a = np.einsum("nik,ni->nk", slopes[0], rays[1] @ E)
    size = np.sqrt(np.sum(of_b**2, axis=1) + np.sum(of_a**2, axis=1))
    # e = b . (t x p): by omega, d p = omega x p; by t, its two directions.
    by_t = np.cross(p, rays[1]) @ _across(t)
    by_turn = np.cross(p, np.cross(rays[1], t))
    J = np.concatenate([by_turn, by_t], axis=1) / size[:, None]
    return e / size, J


def _across(t: Array) -> Array:
    first = np.cross(t, np.eye(3)[np.argmin(np.abs(t))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(t, first)], axis=1)


def _refined(T: Array, rays: Sequence[Array], slopes: Sequence[Array]) -> tuple[Array, bool]:
    for _ in range(_STEPS):
        r, J = _errors(T, rays, slopes)
        step = -np.linalg.lstsq(J, r, rcond=None)[0]
        t = T[:3, 3] + _across(T[:3, 3]) @ step[3:]
        T = se3.make(so3.exp(step[:3]) @ T[:3, :3], t / np.linalg.norm(t))
        if np.linalg.norm(step) < _SETTLED:
            return T, True
    return T, bool(np.linalg.norm(step) < 1e-8)


def _refuse_one_place(rays: Sequence[Array], slopes: Sequence[Array], sigma: float) -> None:
    """Raises: RefusedError where a turn alone explains the matches as well."""
    U, _, Vt = np.linalg.svd(rays[1].T @ rays[0])
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    off = rays[1] - rays[0] @ R.T
    angle = np.sqrt(sum(np.sum(s**2, axis=(1, 2)) / 2 for s in slopes))  # of a pixel in both pictures
    rms = float(np.sqrt(np.mean(np.sum(off**2, axis=1) / 2 / angle**2)))
    if rms < _ONE_PLACE * sigma:
        raise RefusedError(
            f"a turn alone explains the matches to {rms:.2g} px, with {sigma:.2g} px of noise: both pictures are from "
            "one place, or all that they show is far away; move the camera"
        )


def _as_a_b(T_b_a: Array, J: Array, sigma: float) -> tuple[Array, Array]:
    """T_a_b with its covariance. Raises: RefusedError where the direction of t is open."""
    H = J.T @ J
    values = np.linalg.eigvalsh(H)
    lost = values[0] < 1e-14 * values[-1]
    C5 = sigma**2 * np.linalg.pinv(H)
    worst = np.rad2deg(np.sqrt(np.linalg.eigvalsh(C5[3:, 3:])[-1]))
    if lost or worst > LOST_DEG:
        raise RefusedError(
            f"the matches do not tell in which direction the second camera stands ({worst:.0f} deg, 1 sigma); more of "
            "them are needed, farther apart in the pictures and in depth"
        )
    B = np.zeros((6, 5))
    B[:3, :3], B[3:, 3:] = np.eye(3), _across(T_b_a[:3, 3])
    return se3.inverse(T_b_a), of_inverse(T_b_a, B @ C5 @ B.T)
