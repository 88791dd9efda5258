"""Closed-form start for any lens of a planar target: poses and the lens's radial profile, from 20 to 200 degrees.

With square pixels and the axis at the image's centre, a point p = R X + t is imaged along its own direction from the
centre whatever the lens does to its distance from it, u p_y = v p_x (Tsai 1987's radial alignment constraint). For a
plane that is linear in six unknowns of R and t. Orthonormality gives the third row of R up to its sign, and

    r p_z = rho psi(r),  p_z = r31 X + r32 Y + t3,  rho = (u p_x + v p_y) / r,  psi = a0 + a2 r^2 + a4 r^4

is linear in t3 of each view and the profile psi, which all views share (Scaramuzza, Martinelli and Siegwart 2006, "A
flexible technique for accurate omnidirectional camera calibration"). The ray of a pixel is (u, v, psi(r)): looking
sideways at psi = 0 and backwards below. Any camera model is then fitted to these rays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Indices
from calibrant.calibrate.classical import planar as planar_start
from calibrant.calibrate.reprojection import priors as model_priors
from calibrant.calibrate.reprojection.factor import stack
from calibrant.cameras import Camera, CameraModel, camera_model
from calibrant.cameras.splined import FAMILY
from calibrant.data import Observations
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3

SAMPLES = 3000
"""Rays to fit a model to: a profile of a few terms needs no more."""
ENOUGH_PX = 0.01
"""A start need not follow its rays more closely: they are pixels off themselves."""
GRID_MARGIN = 1.1
"""The start's rays are a few degrees off at the rim, and points must not leave the surface while it settles."""
ROUNDS = 5
"""Reweighted rounds: the weights of the views settle in three or four."""


@dataclass(frozen=True, eq=False)
class RadialStart:
    """A lens with a radial profile, and T_camera_plane (m, 4, 4): what the views say before any model is chosen.

    centre (2,) pixels; profile (3,): psi's coefficients of 1, r^2, r^4, r in units of `unit` pixels.
    """

    centre: Array
    unit: float
    profile: Array
    T_camera_plane: Array

    def rays(self, uv: Array) -> Array:
        """Directions (n, 3) of pixels (n, 2), of any length."""
        m = (uv - self.centre) / self.unit
        s = np.sum(m * m, axis=-1)
        return np.concatenate([m, _psi(self.profile, s)[:, None]], axis=-1)

    def angles(self, uv: Array) -> Array:
        """Angles (n,) of pixels from the axis, radians."""
        d = self.rays(uv)
        return np.arctan2(np.hypot(d[:, 0], d[:, 1]), d[:, 2])

    @property
    def focal(self) -> float:
        """Pixels per radian at the axis."""
        return float(self.profile[0] * self.unit)


def radial_start(xy: Array, uv: Array, offsets: Indices, image_size: tuple[int, int]) -> RadialStart:
    """Profile and poses from plane points xy (N, 2), metres, and pixels uv (N, 2) of views laid end to end.

    Raises: RefusedError when the views do not determine a profile that opens forwards.
    """
    centre = (np.array(image_size, dtype=np.float64) - 1) / 2
    unit = float(np.hypot(*image_size)) / 2
    edge = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    middle = _means(xy, offsets)
    local = xy - middle[edge]
    size = float(np.sqrt(np.mean(np.sum(local**2, axis=1))))
    local = local / size
    m = (uv - centre) / unit
    r1, r2, t = _radially_aligned(local, m, offsets, edge)
    profile, forward, depth = _profile(local, m, r1, r2, t, offsets, edge)
    r1 = np.concatenate([r1[:, :2], forward[:, None] * r1[:, 2:]], axis=1)
    r2 = np.concatenate([r2[:, :2], forward[:, None] * r2[:, 2:]], axis=1)
    R = so3.nearest(np.stack([r1, r2, np.cross(r1, r2)], axis=-1))
    position = size * np.concatenate([t, depth[:, None]], axis=1)
    # The origin of `local` is the views' own middle.
    position -= (R[:, :, :2] @ middle[:, :, None])[..., 0]
    return RadialStart(centre, unit, profile, se3.make(R, position))


def _psi(profile: Array, s: Array) -> Array:
    return profile[0] + s * (profile[1] + s * profile[2])


def _means(rows: Array, offsets: Indices) -> Array:
    return np.add.reduceat(rows, offsets[:-1], axis=0) / np.diff(offsets)[:, None]


def _radially_aligned(xy: Array, m: Array, offsets: Indices, edge: Indices) -> tuple[Array, Array, Array]:
    """r1, r2 (n, 3) and t_x, t_y (n, 2) of every view by radial alignment; the third components up to a common sign."""
    X, Y, u, v = xy[:, 0], xy[:, 1], m[:, 0], m[:, 1]
    rows = np.stack([-v * X, -v * Y, -v, u * X, u * Y, u], axis=1)
    normal = np.add.reduceat(rows[:, :, None] * rows[:, None, :], offsets[:-1], axis=0)
    h = np.linalg.eigh(normal)[1][:, :, 0]
    a, b, t = h[:, [0, 3]], h[:, [1, 4]], h[:, [2, 5]]
    p = a[edge] * X[:, None] + b[edge] * Y[:, None] + t[edge]
    sign = np.sign(np.add.reduceat(np.sign(np.sum(p * m, axis=1)), offsets[:-1]))
    sign = np.where(sign == 0, 1.0, sign)[:, None]
    a, b, t = sign * a, sign * b, sign * t
    # r31 r32 = -a.b and |a|^2 + r31^2 = |b|^2 + r32^2
    across, surplus = np.sum(a * b, axis=1), np.sum(a * a, axis=1) - np.sum(b * b, axis=1)
    root = np.sqrt(surplus**2 + 4 * across**2)
    r31 = np.sqrt(np.maximum((root - surplus) / 2, 0))
    r32 = -np.where(across < 0, -1.0, 1.0) * np.sqrt(np.maximum((root + surplus) / 2, 0))
    scale = 1 / np.sqrt(np.sum(a * a, axis=1) + r31**2)[:, None]
    r1 = np.concatenate([a, r31[:, None]], axis=1) * scale
    return r1, np.concatenate([b, r32[:, None]], axis=1) * scale, t * scale


def _profile(
    xy: Array, m: Array, r1: Array, r2: Array, t: Array, offsets: Indices, edge: Indices
) -> tuple[Array, Array, Array]:
    """psi (3,) shared by all views, the sign of each view's third row, and t3 (n,).

    The equation is homogeneous: the wrong sign gives -psi, so each view tells its own by a0 > 0, and a joint solution
    settles those that do not know. Views are weighted to least absolute deviations: a misread board does not bend psi.
    """
    p = r1[edge, :2] * xy[:, :1] + r2[edge, :2] * xy[:, 1:] + t[edge]
    r = np.hypot(m[:, 0], m[:, 1])
    rho = np.sum(p * m, axis=1) / np.maximum(r, 1e-12)
    s = r * r
    A = rho[:, None] * np.stack([np.ones_like(s), s, s * s], axis=1)
    b = r * (r1[edge, 2] * xy[:, 0] + r2[edge, 2] * xy[:, 1])
    # t3 of a view is eliminated by taking out of every column its component along r.
    length = np.add.reduceat(s, offsets[:-1])
    A_r, b_r = np.add.reduceat(A * r[:, None], offsets[:-1], axis=0), np.add.reduceat(b * r, offsets[:-1])
    A_, b_ = A - r[:, None] * (A_r / length[:, None])[edge], b - r * (b_r / length)[edge]
    own = np.add.reduceat(A_[:, :2, None] * A_[:, None, :2], offsets[:-1], axis=0)
    seen = np.add.reduceat(A_[:, :2] * b_[:, None], offsets[:-1], axis=0)
    single = np.linalg.solve(own + 1e-12 * np.trace(own, axis1=1, axis2=2)[:, None, None] * np.eye(2), seen[..., None])
    forward = np.where(single[:, 0, 0] < 0, -1.0, 1.0)
    weight = np.ones(len(forward))
    for _ in range(ROUNDS):
        w = weight[edge]
        profile = np.linalg.lstsq(A_ * w[:, None], b_ * forward[edge] * w, rcond=None)[0]
        fits = [np.add.reduceat((A_ @ profile - sign * b_) ** 2, offsets[:-1]) for sign in (1.0, -1.0)]
        forward = np.where(fits[0] <= fits[1], 1.0, -1.0)
        rms = np.sqrt(np.minimum(*fits) / np.diff(offsets))
        weight = 1 / np.sqrt(rms + 1e-3 * np.median(rms) + 1e-12)
    if not profile[0] > 0:
        raise RefusedError(
            "the views determine no lens: their points do not agree on how far from the axis they are seen. "
            "Are the board's size and the order of its points right? Tilt the board 20 to 45 degrees"
        )
    depth = (A_r @ profile - forward * b_r) / length
    return profile, forward, depth


def fitted(
    kind: CameraModel, rays: Array, uv: Array, *, focal: float, centre: Array, start: Array | None = None
) -> Array:
    """Parameters (k,) of a model whose pixels of the rays (n, 3) are nearest to uv (n, 2), by damped Gauss-Newton.

    focal: pixels per radian at the axis; start (k,): by default the model's neutral values. Rays that the model cannot
    see do not count, and what the rays do not determine stays where it starts.
    """
    step = max(1, len(rays) // SAMPLES)
    rays, uv = rays[::step], uv[::step]
    values = kind.starting_values(focal, centre) if start is None else start
    seen = kind.sees(values, rays)
    rays, uv = rays[seen], uv[seen]
    free = np.array([name not in kind.gauge for name in kind.parameter_names])
    information = model_priors.parameter_information(kind)[np.ix_(free, free)]
    damping = 1e-3
    cost, gradient, normal = _normal_equations(kind, values, rays, uv, free, information)
    for _ in range(50):
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-12 * np.max(np.diag(normal))))
        scaled = normal / np.outer(scale, scale) + damping * np.eye(len(scale))
        trial = values.copy()
        trial[free] -= np.linalg.solve(scaled, gradient / scale) / scale
        attempt = _normal_equations(kind, trial, rays, uv, free, information)
        if np.isfinite(attempt[0]) and attempt[0] < cost:
            small = cost - attempt[0] < 1e-6 * cost or attempt[0] < ENOUGH_PX**2 * len(rays)
            values, (cost, gradient, normal), damping = trial, attempt, max(damping / 5, 1e-9)
            if small:
                break
        else:
            damping *= 5
            if damping > 1e9:
                break
    return values


def transferred(initial: Camera, kind: CameraModel, uv: Array) -> Array:
    """Parameters (k,) of a model that start from a camera of any model.

    Perspective models share the names of their terms, and those left out are 0; others are fitted to the camera's rays
    of the observed pixels uv (n, 2).
    """
    if initial.model.name == kind.name:
        return np.array(initial.values)
    forwards = "inverse_brown" not in (initial.model.name, kind.name)
    if forwards and initial.model.projection == kind.projection == "perspective":
        return np.array([initial.parameters.get(n, kind.neutral.get(n, 0.0)) for n in kind.parameter_names])
    rays = initial.unproject(uv)
    known = np.isfinite(rays).all(axis=1)
    _, J, _ = initial.model.project_with_jacobians(initial.values, [0.0, 0.0, 1.0])
    centre = np.array([initial.parameters["cx"], initial.parameters["cy"]])
    return fitted(kind, rays[known], uv[known], focal=float(J[0, 0]), centre=centre)


def _normal_equations(
    kind: CameraModel, values: Array, rays: Array, uv: Array, free: NDArray[np.bool_], information: Array
) -> tuple[float, Array, Array]:
    """Half the squared error with the model's prior, its gradient and Hessian; infinite where a ray has no pixel."""
    with np.errstate(all="ignore"):
        predicted, _, J = kind.project_with_jacobians(values, rays)
    r = (predicted - uv).ravel()
    x = values[free]
    if not np.all(np.isfinite(r)):
        return np.inf, x, information
    J = J.reshape(len(r), -1)[:, free]
    prior = information @ x
    return 0.5 * float(r @ r + x @ prior), J.T @ r + prior, J.T @ J + information


def poses_of_rays(xy: Array, rays: Array, offsets: Indices) -> tuple[Array, NDArray[np.bool_]]:
    """T_camera_plane (m, 4, 4) from points in the plane and their rays (N, 3), and which views determine theirs.

    Each view is first turned so that its mean ray is the axis: a board seen sideways, or from behind, is then in
    front, and its homography well conditioned.
    """
    unit = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    edge = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    turn = onto_axis(_means(unit, offsets))
    turned = (turn[edge] @ unit[:, :, None])[..., 0]
    ahead = np.minimum.reduceat(turned[:, 2], offsets[:-1]) > 1e-3
    depth = np.where(turned[:, 2:] > 1e-3, turned[:, 2:], 1.0)
    T, good = planar_start.start_poses(xy, np.ascontiguousarray(turned[:, :2] / depth), offsets)
    back = se3.make(np.swapaxes(turn, -1, -2), np.zeros((len(turn), 3)))
    return back @ T, good & ahead


def rays_of(kind: CameraModel, parameters: Array, uv: Array) -> Array:
    """Unit rays (n, 3) of observed pixels. Raises: InputError for a pixel that the starting camera does not reach."""
    rays = kind.unproject(parameters, uv)
    lost = ~np.isfinite(rays).all(axis=1)
    if lost.any():
        bad = uv[lost][0]
        raise InputError(
            f"the initial camera has no ray for the observed pixel ({bad[0]:.1f}, {bad[1]:.1f}); "
            "its distortion does not reach that far: is it a camera of this image size?"
        )
    return rays


def onto_axis(direction: Array) -> Array:
    """Rotations (m, 3, 3) that turn directions (m, 3) onto +z."""
    d = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    axis = np.stack([d[:, 1], -d[:, 0], np.zeros(len(d))], axis=1)  # d x z
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    axis = np.where(sine > 1e-12, axis / np.maximum(sine, 1e-12), [1.0, 0.0, 0.0])
    return so3.exp(axis * np.arctan2(sine, d[:, 2:]))


def parallel_start(xy: Array, uv: Array, offsets: Indices, image_size: tuple[int, int]) -> tuple[float, Array]:
    """Magnification, pixels per metre, and T_camera_plane (m, 4, 4) of a telecentric camera.

    A view's affine map is A = f [r1 r2] without its third row. Some direction in a plane is always seen at full
    length, so the larger singular value of A is f. Depth and the side to which a board leans cannot be seen: the depth
    is ten times the board's size, the lean one of the two.
    """
    centre = (np.array(image_size, dtype=np.float64) - 1) / 2
    edge = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    middle, seen = _means(xy, offsets), _means(uv, offsets)
    local, image = xy - middle[edge], uv - seen[edge]
    moments = np.add.reduceat(local[:, :, None] * local[:, None, :], offsets[:-1], axis=0)
    cross = np.add.reduceat(image[:, :, None] * local[:, None, :], offsets[:-1], axis=0)
    A = cross @ np.linalg.inv(moments)
    f = float(np.median(np.linalg.norm(A, ord=2, axis=(1, 2))))
    a, b = A[:, :, 0] / f, A[:, :, 1] / f
    r31 = np.sqrt(np.maximum(1 - np.sum(a * a, axis=1), 0))
    r32 = -np.where(np.sum(a * b, axis=1) < 0, -1.0, 1.0) * np.sqrt(np.maximum(1 - np.sum(b * b, axis=1), 0))
    r1, r2 = np.concatenate([a, r31[:, None]], axis=1), np.concatenate([b, r32[:, None]], axis=1)
    R = so3.nearest(np.stack([r1, r2, np.cross(r1, r2)], axis=-1))
    depth = np.full((len(A), 1), 10 * float(np.ptp(xy)))
    position = np.concatenate([(seen - centre) / f, depth], axis=1) - (R[:, :, :2] @ middle[:, :, None])[..., 0]
    return f, se3.make(R, position)


def start_parameters(
    kind: CameraModel, xy: Array, uv: Array, offsets: Indices, image_size: tuple[int, int]
) -> tuple[Array, Array]:
    """Parameters (k,) and T_camera_plane (m, 4, 4) to start the refinement of a model from.

    Raises: RefusedError when the views determine no lens, or when the lens sees more than the model can.
    """
    if kind.projection == "parallel":
        magnification, T = parallel_start(xy, uv, offsets, image_size)
        return kind.starting_values(magnification, (np.array(image_size, dtype=np.float64) - 1) / 2), T
    start = radial_start(xy, uv, offsets, image_size)
    values = fitted(kind, start.rays(uv), uv, focal=start.focal, centre=start.centre)
    edge = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    points = np.concatenate([xy, np.zeros((len(xy), 1))], axis=1)
    seen = kind.sees(values, se3.apply(start.T_camera_plane[edge], points))
    if not seen.all():
        raise RefusedError(out_of_sight(kind, start, uv, int(np.sum(~seen))))
    return values, start.T_camera_plane


def out_of_sight(kind: CameraModel, start: RadialStart, uv: Array, lost: int) -> str:
    """Words for a lens that sees more than its model."""
    reach = np.rad2deg(float(np.max(start.angles(uv))))
    return (
        f"the {kind.name} model cannot see {lost} of {len(uv)} points: the views reach {reach:.0f} degrees from the "
        "axis. Use a model for wide lenses (kannala_brandt, unified, extended_unified, double_sphere), or auto"
    )


def model_for(name: str, observations: Observations) -> CameraModel:
    """The model of that name; `splined` alone gets a grid that covers the observed points of the only camera.

    Raises: InputError for an unknown name, or when there are no points to lay a grid over.
    """
    if name != FAMILY:
        return camera_model(name)
    views = [v for v in observations.views if len(v) >= 4]
    if not views:
        raise InputError("there is no view with 4 points or more to lay a grid of control points over")
    stacked = stack(views)
    image_size = next(iter(observations.image_sizes.values()))
    xy = planar_start.in_plane(stacked.points).xy
    return camera_model(splined_grid(xy, stacked.uv, stacked.offsets, image_size))


def splined_grid(xy: Array, uv: Array, offsets: Indices, image_size: tuple[int, int], *, columns: int = 12) -> str:
    """Name of a splined model whose surface covers all points, with square cells."""
    start = radial_start(xy, uv, offsets, image_size)
    d = start.rays(uv)
    q = 2 * d[:, :2] / (np.linalg.norm(d, axis=1) + d[:, 2])[:, None]
    reach = GRID_MARGIN * np.abs(q).max(axis=0)
    spacing = 2 * reach[0] / (columns - 3)
    rows = int(np.clip(np.ceil(2 * reach[1] / spacing) + 3, 4, 100))
    fov = np.ceil(np.rad2deg(4 * np.arctan(reach[0] / 2)))
    return f"splined:{columns}x{rows}:{fov:g}deg"
