"""Residuals of a finished calibration, computed again from its file, and the question whether they are random.

residual = predicted − observed, pixels. Noise has no memory of where it fell; what a model cannot express does. Two
statistics look for it, both on residuals divided by their view's noise and freed of gross outliers:

* the map: mean residual vector of each cell of the image. For pure noise, M = sum_c n_c |mean_c|^2 follows chi^2 with
  two degrees of freedom a cell; the excess over that is the part of the variance that a place in the image explains.
* neighbours: correlation of each residual with its nearest neighbour's on the same target. Board bending, rolling
  shutter and motion show here although their direction changes from view to view.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Indices
from calibrant.calibrate.reprojection.derivatives import turned
from calibrant.calibrate.review.target_points import target_points
from calibrant.data import CalibrationResult, Check, View
from calibrant.errors import InputError
from calibrant.optimize.chances import chi2_tail

_CELLS = (8, 6)
"""Columns and rows of the map: coarse enough for several points a cell, fine enough for a distortion's shape."""
_LEAST_IN_CELL = 5
"""A mean of fewer residuals says little and is moved by one outlier."""
_LEAST_POINTS = 150
"""Fewer points fill too few cells to tell structure from noise."""
_OUTLIER_SIGMAS = 5.0
"""Gaussian noise passes it once in two million: what lies beyond is a fault of its own, reported elsewhere."""
_ALL_WITH_ALL = 500
"""Points of a view up to which all distances are faster than a tree, whose library takes longer to load than that."""
_TOGETHER = 30_000
"""Distances that are computed at once: 0.24 MB, which a processor's nearer cache holds."""
_SIGNIFICANCE = 1e-4
"""One false alarm in ten thousand calibrations."""
_LEAST_SHARE = 0.2
"""Structure that explains less of the variance changes the noise estimate, and every sigma, by under a tenth."""


@dataclass(frozen=True, eq=False)
class ViewResiduals:
    """Residual vectors (n, 2) px at the observed pixels uv (n, 2) of one view, under the pose T_camera_target."""

    id: str
    camera: str
    used: bool
    uv: Array
    residuals: Array
    T_camera_target: Array
    file: str | None = None

    @property
    def rms_px(self) -> float:
        """RMS per point over both axes, NaN without points."""
        return _rms_of_residuals(self.residuals)


def fitted_poses(result: CalibrationResult) -> dict[tuple[str, str], Array]:
    """T_camera_target of each view by (camera, id): as the result states it, else fitted to the view's points.

    Views that were left out are fitted too, so that a person can see why; those that determine no pose are absent.
    """
    stated = {(result.camera_of(v), v.id): v.T_camera_target for v in result.views if v.T_camera_target is not None}
    views = result.observations.views if result.observations else ()
    return stated | _fitted_poses(result, [v for v in views if (v.camera, v.id) not in stated])


def seen_poses(result: CalibrationResult) -> dict[tuple[str, str], Array]:
    """T_camera_target by (camera, view id) from each view's points alone, the camera held: no robot has a say in it.

    Views of a camera that is not calibrated, or that determine no pose, are absent.
    """
    return _fitted_poses(result, result.observations.views if result.observations else ())


def own_poses(result: CalibrationResult, poses: Mapping[tuple[str, str], Array]) -> dict[tuple[str, str], Array]:
    """Poses of the used views, each moved to where the view's points alone have it, the camera held.

    Of the two poses of a flat target that near the one given. Args: poses, T_camera_target by (camera, view id).
    """
    from calibrant.calibrate.pose.target_poses import poses_from  # compiled code: only where there is a lens

    used = {(result.camera_of(v), v.id) for v in result.views if v.used}
    views = result.observations.views if result.observations else ()
    own: dict[tuple[str, str], Array] = {}
    for name, camera in result.cameras.items():
        mine = [v for v in views if v.camera == name and len(v) and (name, v.id) in used and (name, v.id) in poses]
        if not mine:
            continue
        try:
            T = poses_from(camera, mine, np.stack([poses[name, v.id] for v in mine]))
        except InputError:  # a point that was left out may lie behind the camera
            own |= _fitted_poses(replace(result, cameras={name: camera}), mine)
            continue
        own |= {(name, view.id): pose for view, pose in zip(mine, T, strict=True)}
    return own


def view_residuals(result: CalibrationResult, poses: Mapping[tuple[str, str], Array]) -> tuple[ViewResiduals, ...]:
    """Residuals of every view that has a pose and a calibrated camera, in the order of the observations.

    Args: poses, T_camera_target by (camera, view id), e.g. of `fitted_poses`.
    Raises: InputError when the result carries no observations.
    """
    if result.observations is None:
        raise InputError(
            "the result carries no observations: residuals cannot be computed; calibrate again from images"
        )
    used = {(result.camera_of(v), v.id) for v in result.views if v.used}
    out = []
    for view, r in _residuals_of(result, poses):
        seen = np.isfinite(r).all(axis=-1)
        uv = view.uv
        if not seen.all():
            uv, r = uv[seen], r[seen]
        key = (view.camera, view.id)
        out.append(ViewResiduals(view.id, view.camera, key in used, uv, r, poses[key], view.file))
    return tuple(out)


def _residuals_of(result: CalibrationResult, poses: Mapping[tuple[str, str], Array]) -> Iterator[tuple[View, Array]]:
    """Each view with a pose and a camera, and its residuals; the points of all of a camera's views go through its model
    at once, which takes a fraction of the time of one after the other."""
    views = result.observations.views if result.observations else ()
    found: dict[tuple[str, str], Array] = {}
    for name, camera in result.cameras.items():
        mine = [v for v in views if v.camera == name and (name, v.id) in poses]
        if not mine:
            continue
        points = target_points(result, mine)
        offsets = np.cumsum([0, *(len(v) for v in mine)])
        T = np.stack([poses[name, v.id] for v in mine])
        seen_from = turned(T, np.concatenate(points), offsets) + np.repeat(T[:, :3, 3].T, np.diff(offsets), axis=1)
        r = camera.project(seen_from.T) - np.concatenate([v.uv for v in mine])
        found |= {(name, v.id): r[a:b] for v, (a, b) in zip(mine, pairwise(offsets.tolist()), strict=True)}
    return ((v, found[v.camera, v.id]) for v in views if (v.camera, v.id) in found)


@dataclass(frozen=True, eq=False)
class Structure:
    """Share of the residuals' variance that a place in the image explains, and the correlation of neighbours, each with
    its chance from noise alone; points: how many residuals were asked, none of them where they are too few."""

    points: int
    share: float = 0.0
    share_chance: float = 1.0
    neighbour: float = 0.0
    neighbour_chance: float = 1.0

    @property
    def lens_too_simple(self) -> bool:
        """Whether the image has a pattern that the camera model does not follow."""
        return self.share_chance < _SIGNIFICANCE and self.share > _LEAST_SHARE

    @property
    def neighbours_alike(self) -> bool:
        """Whether points of a view err alike."""
        return self.neighbour_chance < _SIGNIFICANCE and self.neighbour > _LEAST_SHARE

    def check(self, *, held: bool = False) -> Check:
        """In words. The value is the share of the variance that a place in the image, or a neighbour, explains.

        Args: held: the stated covariance counts what neighbours share.
        """
        if self.points < _LEAST_POINTS:
            message = f"{self.points} points are too few to tell structure in the residuals"
            return Check("residual-structure", "ok", message)
        if self.lens_too_simple:
            message = (
                f"{100 * self.share:.0f} % of the residuals' variance repeats at the same places of the image: the "
                "camera model is too simple for this lens; free more distortion terms or take another model"
            )
            return Check("residual-structure", "warn", message, self.share)
        if self.neighbours_alike and held:
            message = f"neighbouring points err alike (correlation {self.neighbour:.2f}), and every sigma holds it"
            return Check("residual-structure", "ok", message, self.neighbour)
        if self.neighbours_alike:
            message = (
                f"neighbouring points err alike (correlation {self.neighbour:.2f}), so the stated uncertainties are "
                "too small: look for a board that is not flat, a board or camera that moved during exposure, or a "
                "rolling shutter"
            )
            return Check("residual-structure", "warn", message, self.neighbour)
        message = (
            f"the residuals of {self.points} points look random: no place in the image and no neighbour explains them"
        )
        return Check("residual-structure", "ok", message, max(self.share, self.neighbour, 0.0))


def structure_of(views: tuple[ViewResiduals, ...], *, image_size: tuple[int, int]) -> Structure:
    """Whether the residuals of the used views look random.

    Args: views of one camera; image_size (width, height) px.
    """
    kept = _standardised([v for v in views if v.used and len(v.uv) >= 3])
    count = sum(len(uv) for uv, _ in kept)
    if count < _LEAST_POINTS:
        return Structure(count)
    uv, e = (np.concatenate(part) for part in zip(*kept, strict=True))
    return Structure(count, *_map_share(uv, e, image_size), *_neighbour_share(kept))


def structure_check(views: tuple[ViewResiduals, ...], *, image_size: tuple[int, int], held: bool = False) -> Check:
    """`structure_of` in words, and what it means when residuals are not random."""
    return structure_of(views, image_size=image_size).check(held=held)


def _fitted_poses(result: CalibrationResult, views: Sequence[View]) -> dict[tuple[str, str], Array]:
    """Poses of the views by (camera, id), each camera held; views that determine none are absent."""
    from calibrant.calibrate.pose.target_poses import target_poses  # compiled code: only where a pose is missing

    poses: dict[tuple[str, str], Array] = {}
    for name, camera in result.cameras.items():
        mine = [v for v in views if v.camera == name]
        # All at once is many times faster; one view without a pose refuses them all, and then each goes alone.
        batches = [mine] if mine else []
        while batches:
            batch = batches.pop()
            try:
                T = target_poses(camera, batch).T_camera_target
            except InputError:  # too few points, or outside the camera's field
                batches += [[view] for view in batch] if len(batch) > 1 else []
                continue
            poses |= {(name, view.id): pose for view, pose in zip(batch, T, strict=True)}
    return poses


def _rms_of_residuals(residuals: Array) -> float:
    return float(np.sqrt(np.vdot(residuals, residuals) / len(residuals))) if len(residuals) else float("nan")


def _standardised(views: Sequence[ViewResiduals]) -> list[tuple[Array, Array]]:
    """Pixels and residuals of each view over its noise per axis (from the median, so that outliers do not set it)."""
    out: list[tuple[Array, Array]] = []
    # Views of as many points together: NumPy's calls for one take longer than its numbers.
    for _, alike in groupby(views, lambda v: len(v.uv)):
        several = list(alike)
        r = np.stack([v.residuals for v in several])
        squared = np.einsum("mni,mni->mn", r, r)
        # The squared length of a 2D Gaussian has the median 2 ln 2 sigma^2.
        sigma = np.maximum(np.sqrt(np.median(squared, axis=1) / (2 * np.log(2))), np.finfo(float).tiny)
        keep = squared < np.square(_OUTLIER_SIGMAS * sigma)[:, None]
        mean = np.sum(squared, axis=1, where=keep) / np.maximum(keep.sum(axis=1), 1)
        e = r / np.maximum(np.sqrt(mean / 2), np.finfo(float).tiny)[:, None, None]
        whole = keep.all(axis=1)
        out += [
            (v.uv, mine) if all_ else (v.uv[k], mine[k]) for v, mine, k, all_ in zip(several, e, keep, whole.tolist())
        ]
    return out


def places(uv: Array, image_size: tuple[int, int]) -> Indices:
    """The place (N,) in the image of each pixel (N, 2), by the number of its cell of the map."""
    # Axis by axis: rows of two numbers take many times as long.
    column, row = (
        np.clip((x + 0.5) / size * cells, 0, cells - 1).astype(np.int64)
        for x, size, cells in zip(uv.T, image_size, _CELLS)
    )
    return np.asarray(row * _CELLS[0] + column)


def _map_share(uv: Array, e: Array, image_size: tuple[int, int]) -> tuple[float, float]:
    """Share of the variance that the cell means explain beyond chance, and the chance of as much from pure noise."""
    index = places(uv, image_size)
    size = _CELLS[0] * _CELLS[1]
    n = np.bincount(index, minlength=size)
    sums = np.stack([np.bincount(index, weights=e[:, k], minlength=size) for k in (0, 1)], axis=-1)
    good = n >= _LEAST_IN_CELL
    if not good.any():
        return 0.0, 1.0
    statistic = float(np.sum(sums[good] ** 2 / n[good, None]))
    freedom = 2 * int(good.sum())
    share = (statistic - freedom) / (2 * float(n[good].sum()))
    return share, chi2_tail(freedom, statistic)


def _nearest_neighbours(views: Sequence[Array]) -> Iterator[NDArray[np.intp]]:
    """For the pixels (n, 2) of each view the row of each one's nearest other one, (n,)."""
    for count, alike in groupby(views, len):
        if count > _ALL_WITH_ALL:
            from scipy.spatial import cKDTree

            yield from (np.asarray(cKDTree(uv).query(uv, k=2)[1])[:, 1] for uv in alike)
            continue
        # Views of as many points together, as far as they fit: NumPy's calls for one take longer than its distances.
        u, v = (x - x.mean(axis=1, keepdims=True) for x in np.moveaxis(np.stack(list(alike)), 2, 0))
        # |a - b|^2 - |a|^2 = |b|^2 - 2 a b: the same b is nearest, in one product.
        of, onto = np.stack([u, v, np.ones_like(u)], axis=2), np.stack([-2 * u, -2 * v, u * u + v * v], axis=1)
        size = max(1, _TOGETHER // count**2)
        for first in range(0, len(u), size):
            squares = of[first : first + size] @ onto[first : first + size]
            squares[:, np.arange(count), np.arange(count)] = np.inf
            yield from np.argmin(squares, axis=2)


def _neighbour_share(kept: list[tuple[Array, Array]]) -> tuple[float, float]:
    """Correlation of residuals with their nearest neighbour's in the same view, and its one-sided chance."""
    enough = [(uv, e) for uv, e in kept if len(uv) > 1]
    if not enough:
        return 0.0, 1.0
    e = np.concatenate([e for _, e in enough])
    first = np.cumsum([0, *(len(uv) for uv, _ in enough[:-1])])
    own = _nearest_neighbours([uv for uv, _ in enough])
    nearest = np.concatenate([start + rows for start, rows in zip(first, own, strict=True)])
    # A mutual pair would be counted twice and look like twice the evidence.
    i = np.arange(len(e))
    once = np.flatnonzero((nearest[nearest] != i) | (i < nearest))
    products, pairs = float(np.vdot(e[once], e[nearest[once]])), len(once)
    correlation = products / (2 * pairs)
    z = correlation * np.sqrt(2 * pairs)  # each product of two unit normals has variance 1
    return correlation, 0.5 * chi2_tail(1, z * z) if z > 0 else 1.0
