"""What each view says about the lens, the board and the shutter, once its own pose is projected out.

At the end of a calibration the residuals r = predicted - seen of a view are linear in all that could still be wrong:
r = J_pose x + J e + noise, with e the lens's parameters, a lens of the view's own, a bend of the board, a skew of the
shutter. The pose is free, so that only what is left beside its columns counts, and all of it is in one small matrix,

    M_v = [J r]^T (I - J_pose (J_pose^T J_pose)^-1 J_pose^T) [J r] / sigma_i^2.

Every question "is e other than zero?" is answered from the sums of these matrices (`estimate`), without another fit:
to first order, which is what small faults need; a large one is seen as well, its size is then rough.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from calibrant.arrays import Array, Indices, Mask
from calibrant.calibrate.reprojection.derivatives import derivatives, turned
from calibrant.calibrate.reprojection.factor import StackedViews, stack
from calibrant.calibrate.reprojection.outliers import MINIMUM_POINTS, mark
from calibrant.calibrate.review.target_points import across, target_points
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, View
from calibrant.optimize.chances import chi2_tail

ZOOM, CENTRE, ASPECT, BEND, STRETCH = "zoom", "centre", "aspect", "bend", "stretch"
ASKEW, SKEW, SHEAR, RADIAL = "askew", "skew", "shear", "radial"
"""Columns beside the lens's: the image scaled about the principal point (1); shifted (px); scaled in height alone (1);
the board bent in its three quadratic modes (mm); stretched along its x (1); its rows shifted along x in proportion to y
(1); the image's rows shifted in proportion to their place, along x and y (px an image), and along x alone, for what all
views share; the image stretched with the square of the distance from the principal point (px at the rim)."""
POSE = 6
_MOST_LENS_PARAMETERS = 30
"""A splined lens has hundreds, each seen in a corner of the image: its views are compared by scale and shift alone."""
SINGULAR = 1e-9
"""Eigenvalue of the scaled information below which a direction is not determined: sigma would be 30,000 times that of
the others alone."""


@dataclass(frozen=True, eq=False)
class ViewScores:
    """Gram matrices gram (n, F, F) of the columns, the pose projected out; the last column is the residual.

    columns: where each kind of column stands; lens: those of the free lens parameters, parameter_indices theirs in the
    camera; sigma_px: noise per axis; freedom: of the residuals; pixels (N, 2): where the points are seen.
    X (6 + F, 2, N): the columns themselves, those of the pose first, each row over its relative sigma.
    """

    camera: Camera
    ids: tuple[str, ...]
    gram: Array
    lens: Indices
    parameter_indices: Indices
    columns: Mapping[str, Indices]
    sigma_px: float
    freedom: int
    pixels: Array
    X: Array

    def __len__(self) -> int:
        return len(self.ids)

    @cached_property
    def together(self) -> Array:
        """Sum of the Gram matrices, (F, F): what all views say."""
        return self.gram.sum(axis=0)


@dataclass(frozen=True, eq=False)
class Rows:
    """What `ViewScores` are made from: the used views laid end to end, and the derivatives at their points.

    stacked: points as the calibration has them (bent or free targets too); view (N,) of each point; weight (N,), 0 for
    points left out; seen_from (3, N) in the target's axes turned into the camera's, without its place; J_point
    (N, 2, 3), J_lens (N, 2, k), residuals (N, 2), pixels (N, 2) predicted; T_camera_target (n, 4, 4); max_error_px, the
    limit that points are left out by, None for that of the residuals.
    """

    camera: Camera
    views: tuple[View, ...]
    stacked: StackedViews
    view: Indices
    weight: Array
    seen_from: Array
    J_point: Array
    J_lens: Array
    residuals: Array
    pixels: Array
    T_camera_target: Array
    max_error_px: float | None


def rows_of(result: CalibrationResult, camera_name: str, poses: Mapping[tuple[str, str], Array]) -> Rows | None:
    """Rows of a camera's used views; None where fewer than three have a pose, or the lens was held.

    Args: poses, T_camera_target by (camera, view id), as the image alone has them.
    """
    camera = result.cameras[camera_name]
    if result.observations is None or camera.covariance is None or not np.any(np.diag(camera.covariance) > 0):
        return None
    used = {v.id for v in result.views if v.used and result.camera_of(v) == camera_name}
    views = tuple(
        v for v in result.observations.views
        if v.camera == camera_name and v.id in used and len(v) and (camera_name, v.id) in poses
    )  # fmt: skip
    if len(views) < 3:
        return None
    stacked = _shaped(result, views)
    T = np.stack([poses[camera_name, v.id] for v in views])
    return rows_at(camera, views, stacked, T, max_error_px=result.options.get("max_error_px"))


def rows_at(
    camera: Camera, views: tuple[View, ...], stacked: StackedViews, T: Array, *, max_error_px: float | None
) -> Rows:
    """The rows of these points at these poses T_camera_target (n, 4, 4)."""
    view = np.repeat(np.arange(len(views)), np.diff(stacked.offsets))
    seen_from = turned(T, stacked.points, stacked.offsets)
    pixels, J_point, J_lens = derivatives(camera, (seen_from + T[view, :3, 3].T).T)
    residuals = pixels - stacked.uv
    norms = np.sqrt(np.einsum("ni,ni->n", residuals, residuals))
    finite = np.isfinite(norms) & np.isfinite(J_lens).all(axis=(1, 2))
    if not finite.all():
        norms = np.where(finite, norms, np.inf)
        residuals, J_point, J_lens, pixels = (
            np.where(finite.reshape(-1, *[1] * (a.ndim - 1)), a, 0.0) for a in (residuals, J_point, J_lens, pixels)
        )
    keep = mark(norms, stacked.offsets, max_error_px=max_error_px).keep & finite
    weight = keep / stacked.sigma
    return Rows(camera, views, stacked, view, weight, seen_from, J_point, J_lens, residuals, pixels, T, max_error_px)


def _shaped(result: CalibrationResult, views: Sequence[View]) -> StackedViews:
    """The views end to end, their points where the calibration found them on a target that is not flat."""
    stacked = stack(views)
    return replace(stacked, points=np.concatenate(target_points(result, views)))


def view_scores(rows: Rows) -> ViewScores | None:
    """The scores of the rows; None where the noise cannot be told for want of points."""
    camera, k_all = rows.camera, rows.J_lens.shape[2]
    free = np.flatnonzero(np.diag(np.asarray(camera.covariance)) > 0)
    if k_all > _MOST_LENS_PARAMETERS:
        free = np.array([camera.model.index(n) for n in ("fx", "fy", "cx", "cy")])
    k = len(free)
    names = {ZOOM: 1, CENTRE: 2, ASPECT: 1, BEND: 3, STRETCH: 1, ASKEW: 1, SKEW: 2, RADIAL: 1}
    ends = np.cumsum([k, *names.values()])
    columns = {name: np.arange(a, b) for name, (a, b) in zip(names, pairwise(ends.tolist()))}
    columns[SHEAR] = columns[SKEW][:1]
    # Column by column and axis by axis, as the derivatives lie: filled several times faster than row by row.
    X = np.empty((POSE + int(ends[-1]) + 1, 2, len(rows.view)))
    J = np.moveaxis(rows.J_point, (2, 1), (0, 1))
    _pose_columns(X, J, rows)
    if k_all > _MOST_LENS_PARAMETERS:
        _affine_lens_columns(X[POSE:], camera, rows.pixels)
    else:
        X[POSE : POSE + k] = np.moveaxis(rows.J_lens, (2, 1), (0, 1))[free]
    _own_columns(X[POSE:], columns, J, rows)
    X[-1] = rows.residuals.T
    if not np.all(rows.weight == 1.0):
        X *= rows.weight
    if rows.stacked.whitening is not None:
        X[:] = np.einsum("nij,qjn->qin", rows.stacked.whitening, X)
    kept = np.add.reduceat((rows.weight > 0).astype(np.int64), rows.stacked.offsets[:-1]) >= MINIMUM_POINTS
    gram = _without_poses(_grams(X, rows.stacked.offsets))
    gram[~kept] = 0.0  # a view without points enough for its pose says nothing
    lens = np.arange(k)
    b, r = gram[:, :k, -1].sum(axis=0), float(gram[:, -1, -1].sum())
    freedom = 2 * int(np.count_nonzero(rows.weight[kept[rows.view]])) - POSE * int(kept.sum()) - k
    if freedom < 1:
        return None
    inverse = _inverse(gram[:, :k, :k].sum(axis=0))
    if inverse is None:
        return None
    squares = max(r - float(b @ inverse @ b), 0.0)
    ids = tuple(v.id for v in rows.views)
    sigma_px = max(float(np.sqrt(squares / freedom)), np.finfo(float).tiny)
    return ViewScores(camera, ids, gram, lens, free, columns, sigma_px, freedom, rows.pixels[rows.weight > 0], X)


def _pose_columns(X: Array, J: Array, rows: Rows) -> None:
    """Turns and moves of the target seen from the camera: d pixel = J (w x p + t)."""
    x, y, z = rows.seen_from
    X[0] = J[2] * y - J[1] * z
    X[1] = J[0] * z - J[2] * x
    X[2] = J[1] * x - J[0] * y
    X[3:POSE] = J


def _affine_lens_columns(X: Array, camera: Camera, pixels: Array) -> None:
    """fx, fy, cx, cy as far as a scale and a shift of the image tell them."""
    fx, fy, cx, cy = (camera.parameters[n] for n in ("fx", "fy", "cx", "cy"))
    X[:4] = 0.0
    X[0, 0], X[1, 1] = (pixels[:, 0] - cx) / fx, (pixels[:, 1] - cy) / fy
    X[2, 0] = X[3, 1] = 1.0


def _own_columns(X: Array, columns: Mapping[str, Indices], J: Array, rows: Rows) -> None:
    """What a view, the board or the shutter may have of its own."""
    counts = np.diff(rows.stacked.offsets)
    u, v = (x - rows.camera.parameters[name] for x, name in zip(rows.pixels.T, ("cx", "cy")))
    from_centre = np.stack([u, v])
    zoom, centre, bend = columns[ZOOM][0], columns[CENTRE][0], columns[BEND][0]
    X[zoom] = from_centre
    X[centre : centre + 2] = 0.0
    X[centre, 0] = X[centre + 1, 1] = 1.0
    aspect = columns[ASPECT][0]
    X[aspect, 0], X[aspect, 1] = 0.0, v
    points = rows.stacked.points
    x, y = np.ascontiguousarray(points[:, :2].T)
    along_x, along_y = x - x.mean(), y - y.mean()
    x, y = (across(c, c.min(), c.max()) for c in (x, y))
    axis, normal = (np.repeat(rows.T_camera_target[:, :3, c].T, counts, axis=1) for c in (0, 2))
    out_of_plane = 1e-3 * (J[0] * normal[0] + J[1] * normal[1] + J[2] * normal[2])
    for at, height in enumerate((1 - x**2, x * y, 1 - y**2)):
        np.multiply(out_of_plane, height, out=X[bend + at])
    along = J[0] * axis[0] + J[1] * axis[1] + J[2] * axis[2]
    np.multiply(along, along_x, out=X[columns[STRETCH][0]])
    np.multiply(along, along_y, out=X[columns[ASKEW][0]])
    skew, row = columns[SKEW][0], v / rows.camera.image_size[1]
    X[skew : skew + 2] = 0.0
    X[skew, 0] = X[skew + 1, 1] = row
    squared = u * u + v * v
    rim = max(float(squared.max()), 1.0)
    np.multiply(from_centre, squared / rim**1.5, out=X[columns[RADIAL][0]])


def _grams(X: Array, offsets: Indices) -> Array:
    """X_v X_v^T of every view, (n, F, F)."""
    width, counts = X.shape[0], np.diff(offsets)
    if np.all(counts == counts[0]):
        u, v = (np.swapaxes(X[:, axis].reshape(width, len(counts), -1), 0, 1) for axis in (0, 1))
        return u @ np.swapaxes(u, 1, 2) + v @ np.swapaxes(v, 1, 2)
    parts = (X[:, :, a:b].reshape(width, -1) for a, b in pairwise(offsets.tolist()))
    return np.stack([part @ part.T for part in parts])


def _without_poses(gram: Array) -> Array:
    """The Gram matrices once each view's pose is projected out, (n, F - 6, F - 6)."""
    scale = 1 / np.sqrt(np.maximum(np.einsum("nii->ni", gram[:, :POSE, :POSE]), np.finfo(float).tiny))
    pose = gram[:, :POSE, :POSE] * scale[:, :, None] * scale[:, None, :]
    # A view whose pose is barely determined keeps its undetermined direction: nothing is projected along it.
    pose += np.eye(POSE) * np.finfo(float).eps * POSE
    across = gram[:, :POSE, POSE:] * scale[:, :, None]
    return gram[:, POSE:, POSE:] - np.swapaxes(across, 1, 2) @ np.linalg.solve(pose, across)


def _inverse(A: Array) -> Array | None:
    """Inverse of a symmetric matrix, None where a direction of it is not determined."""
    d = np.diag(A)
    if not np.all(d > 0):
        return None
    scale = 1 / np.sqrt(d)
    values, vectors = np.linalg.eigh(A * scale[:, None] * scale)
    if values[0] < SINGULAR:
        return None
    scaled = vectors * scale[:, None]
    return np.asarray((scaled / values) @ scaled.T)


@dataclass(frozen=True, eq=False)
class Estimate:
    """Unknowns found from the scores: value (m,), classical covariance (m, m), and moved (n, m): by how much each
    unknown moves when a view is left out, None where the views without one do not determine them all."""

    value: Array
    covariance: Array
    moved: Array | None

    def chi_square(self, chosen: Indices) -> float:
        """value^T C^-1 value of some of the unknowns."""
        x, C = self.value[chosen], self.covariance[np.ix_(chosen, chosen)]
        return float(x @ np.linalg.solve(C, x))


def estimate(
    scores: ViewScores, columns: Indices, weights: Array | None = None, *, leave_out: bool = False
) -> Estimate | None:
    """The unknowns that belong to some columns, each view's column taken times its weight; None if undetermined.

    Args: columns (m,) of the Gram matrices; weights (n, m): 1 where the view has the unknown, 0 where it has not; all
    have all where it is not given.
    """
    M = y = None
    if weights is None and not leave_out:
        A, total = scores.together[columns[:, None], columns], scores.together[columns, -1]
    else:
        M, y = scores.gram[:, columns[:, None], columns[None, :]], scores.gram[:, columns, -1]
        if weights is not None:
            M, y = M * weights[:, :, None] * weights[:, None, :], y * weights
        A, total = M.sum(axis=0), y.sum(axis=0)
    inverse = _inverse(A)
    if inverse is None:
        return None
    value = -inverse @ total
    covariance = inverse * scores.sigma_px**2
    if not leave_out or M is None or y is None:
        return Estimate(value, covariance, None)
    scale = 1 / np.sqrt(np.diag(A))
    without = (A - M) * scale[:, None] * scale
    if np.linalg.eigvalsh(without)[:, 0].min() < SINGULAR:
        return Estimate(value, covariance, None)
    left = -scale * np.linalg.solve(without, ((total - y) * scale)[:, :, None])[..., 0]
    return Estimate(value, covariance, left - value)


@dataclass(frozen=True, eq=False)
class OwnOfViews:
    """What each view alone says of columns of its own: squares (n,) over the noise, freedom (n,) of each, value (n, q)
    and precision (n, q) of each column with the others held."""

    squares: Array
    freedom: Array
    value: Array
    precision: Array

    @property
    def chance(self) -> float:
        """P of squares as large, had no view any and the noise were white."""
        return chi2_tail(float(self.freedom.sum()), float(self.squares.sum()))


def own_of_views(scores: ViewScores, *names: str) -> OwnOfViews:
    """The score test of columns that every view has for itself: s_v^T I_v^-1 s_v, summed chi-square when none has."""
    E, L = np.concatenate([scores.columns[n] for n in names]), scores.lens
    gram = scores.gram
    inverse = _inverse(gram[:, L[:, None], L].sum(axis=0))
    beta = np.zeros(len(L)) if inverse is None else inverse @ gram[:, L, -1].sum(axis=0)
    own, across = gram[:, E[:, None], E], gram[:, E[:, None], L]
    s = gram[:, E, -1] - across @ beta
    d = np.einsum("nii->ni", own)
    # A board seen face on says nothing of the scale, no board anything of a lens whose rays meet nowhere: such a
    # direction is 0 over 0, or rounding, and must count for nothing.
    told = d > np.finfo(float).eps * d.max(axis=0)
    scale = np.where(told, 1 / np.sqrt(np.where(told, d, 1.0)), 0.0)
    turned = np.linalg.inv(own * scale[:, :, None] * scale[:, None, :] + SINGULAR * np.eye(len(E)))
    turned *= scale[:, :, None] * scale[:, None, :]
    squares = np.einsum("ni,nij,nj->n", s, turned, s) / scores.sigma_px**2
    held = np.zeros_like(own) if inverse is None else across @ inverse @ np.swapaxes(across, 1, 2)
    freedom = np.einsum("nij,nji->n", turned, own - held)
    with np.errstate(divide="ignore", invalid="ignore"):
        value = np.where(d > 0, -s / d, 0.0)
    return OwnOfViews(squares, np.maximum(freedom, 0.0), value, d / scores.sigma_px**2)


def kept_columns(scores: ViewScores, *names: str) -> tuple[Indices, Indices]:
    """Columns of the lens and of the names, and where among them the names' stand."""
    own = np.concatenate([scores.columns[n] for n in names])
    return np.concatenate([scores.lens, own]), len(scores.lens) + np.arange(len(own))


def only_in(scores: ViewScores, columns: Indices, own: Indices, views: Mask) -> Array:
    """Weights (n, m): the lens in all views, the own columns in the views given."""
    weights = np.ones((len(scores), len(columns)))
    weights[:, own] = views[:, None]
    return weights


def lens_shift(scores: ViewScores, shift: Array) -> float:
    """Squared shift of fx, fy, cx, cy over the covariance stated, per parameter. Args: shift (k,) of the lens."""
    camera = scores.camera
    known = scores.parameter_indices.tolist()
    named = [camera.model.index(name) for name in ("fx", "fy", "cx", "cy")]
    at = [known.index(i) for i in named if i in known]
    if not at or camera.covariance is None:
        return 0.0
    chosen = scores.parameter_indices[at]
    C = camera.covariance[np.ix_(chosen, chosen)]
    return float(shift[at] @ np.linalg.lstsq(C, shift[at], rcond=None)[0]) / len(at)


def as_photos_make_it(scores: ViewScores) -> ViewScores:
    """The scores of a lens whose covariance holds, beside what is stated, what the views scatter among each other: a
    robot makes a lens look more certain than its photos are, and what they do to it is no less for that."""
    n, camera = len(scores), scores.camera
    found = estimate(scores, scores.lens, leave_out=True)
    if found is None or found.moved is None or camera.covariance is None:
        return scores
    covariance = camera.covariance.copy()
    covariance[np.ix_(scores.parameter_indices, scores.parameter_indices)] += (n - 1) / n * found.moved.T @ found.moved
    return replace(scores, camera=replace(camera, covariance=covariance))
