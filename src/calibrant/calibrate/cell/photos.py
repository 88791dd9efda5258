"""From photos to what the problem of a cell takes: the camera's role, and the views ruled out before."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.lens_choice import LensChoice
from calibrant.calibrate.cell.problem.camera_role import CameraRole, found_camera, prior_camera
from calibrant.calibrate.cell.problem.views import LEAST_SIGMA_PX
from calibrant.calibrate.cell.problem.views import MINIMUM_POINTS as ENOUGH_POINTS
from calibrant.calibrate.intrinsics.fit import ORDINARY
from calibrant.calibrate.intrinsics.one_model import calibrate_keeping
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.calibrate.reprojection.held import ASPECT, expand_fix
from calibrant.calibrate.reprojection.outliers import CAUCHY_SCALE_SIGMAS, Marked, mark, view_reason
from calibrant.calibrate.reprojection.weak_terms import weak_terms_information
from calibrant.calibrate.reprojection.weights import reweighted
from calibrant.calibrate.starts.any_lens import transferred
from calibrant.cameras import Camera, camera_model
from calibrant.data import Observations, RobotPoses, View, ViewResult
from calibrant.errors import InputError, RefusedError
from calibrant.optimize.losses import Loss, cauchy

ON_A_LINE = 1e-4
"""Scatter across over scatter along, below which points lie on a line: 0.01 mm on 100 mm, as flat as paper is."""


@dataclass(frozen=True, eq=False)
class Judged:
    """Views that a given camera can have taken, weighted, without points that do not belong; the others, and why."""

    views: tuple[View, ...]
    left_out: tuple[ViewResult, ...]


@dataclass(frozen=True, eq=False)
class Photographed:
    """A camera's part in a cell: its role, for each of its lists the views that its own calibration kept, those left
    out, the pixel noise and the target poses by view that the calibration found; None for a camera that was given."""

    role: CameraRole
    views: tuple[tuple[View, ...], ...]
    left_out: tuple[ViewResult, ...]
    sigma_px: float | None
    T_camera_target: Mapping[str, Array] | None


def named_by_poses(observations: Observations, poses: RobotPoses, *, given_ids: bool) -> Observations:
    """Views that carry the poses' ids: by name when the poses have names, else by order."""
    if len(observations.image_sizes) != 1:
        raise InputError(f"hand-eye calibration takes one camera, got {', '.join(observations.image_sizes)}")
    if given_ids:
        return observations
    if len(observations.views) != len(poses):
        raise InputError(
            f"{len(poses)} robot poses without names but {len(observations.views)} views with a target; "
            "give RobotPoses with the views' ids, or one pose a view"
        )
    views = tuple(replace(v, moment=i) for v, i in zip(observations.views, poses.ids))
    return replace(observations, views=views)


def photographed(lists: Sequence[Observations], lens: LensChoice) -> Photographed:
    """A camera that is given, or that all its lists of views calibrate. Raises as `calibrate_intrinsics` does."""
    every = tuple(v for seen in lists for v in seen.views)
    if lens.given is not None:
        judged = judge(every, lens.given)
        role, views, left_out = prior_camera(lens.given), judged.views, judged.left_out
        sigma, seen_at = None, None
    elif lens.together and lens.initial is not None:
        return _placed(lists, every, lens, lens.initial)
    else:
        together = replace(lists[0], views=every)
        kept = calibrate_keeping(together, model=lens.model, fix=lens.fix, initial=lens.initial, stop=lens.stop)
        if not kept.solution.converged and lens.stop != ORDINARY:
            raise RefusedError(f"convergence: its own photos' calibration {kept.solution.message}; allow more steps")
        role = found_camera(kept.result.camera, lens.fix)
        views, left_out = kept.views, tuple(v for v in kept.result.views if not v.used)
        sigma = max(kept.result.sigma_px or 0.0, LEAST_SIGMA_PX)
        seen_at = dict(zip((v.id for v in views), kept.solution.value("T_camera_target")))
    by_id = {v.id: v for v in views}
    parts = tuple(tuple(by_id[v.id] for v in seen.views if v.id in by_id) for seen in lists)
    return Photographed(role, parts, left_out, sigma, seen_at)


def _placed(lists: Sequence[Observations], every: Sequence[View], lens: LensChoice, initial: Camera) -> Photographed:
    """A camera that is found in the whole alone: where it starts, and its views as it sees them from there."""
    kind = camera_model(lens.model)
    start = Camera(kind, initial.image_size, transferred(initial, kind, np.concatenate([v.uv for v in every])))
    judged = judge(every, start)
    held, tied = expand_fix(lens.fix, kind)
    role = CameraRole(start, held, tied=(ASPECT,) if tied else (), weak=weak_terms_information(start))
    parts = tuple(tuple(v for v in judged.views if any(v.id == w.id for w in seen.views)) for seen in lists)
    if not judged.views:
        return Photographed(role, parts, judged.left_out, LEAST_SIGMA_PX, {})
    found = target_poses(start, judged.views).T_camera_target
    freedom = max(sum(2 * len(v) - 6 for v in judged.views), 1)
    sigma = float(np.sqrt(np.sum(_squares(judged.views, start)) / freedom))
    seen_at = dict(zip((v.id for v in judged.views), found))
    return Photographed(role, parts, judged.left_out, max(sigma, LEAST_SIGMA_PX), seen_at)


def judge(views: Sequence[View], camera: Camera) -> Judged:
    """What `calibrate_intrinsics` does to the views it calibrates from, for a camera that is given.

    Each view is fitted by its own pose; points that do not belong are found by a robust fit and left out; what is left
    weighs with the detector's sigma and the excess noise. Views with too few points for a pose are passed on.
    """
    out: dict[str, str] = {v.id: _line_reason(v) for v in views if len(v) >= ENOUGH_POINTS and _on_a_line(v)}
    fitted = [v for v in views if len(v) >= ENOUGH_POINTS and v.id not in out]
    if fitted:
        marked = _mark(fitted, camera, None, 1.0)
        if not marked.keep.all():
            marked = _mark(fitted, camera, cauchy(CAUCHY_SCALE_SIGMAS), max(marked.sigma_px, LEAST_SIGMA_PX))
        typical = marked.sigma_px * np.sqrt(2)
        parts = np.split(marked.keep, np.cumsum([len(v) for v in fitted])[:-1])
        kept = [v.subset(keep) for v, keep in zip(fitted, parts) if keep.sum() >= ENOUGH_POINTS]
        out |= {v.id: view_reason(len(v), typical) for v, keep in zip(fitted, parts) if keep.sum() < ENOUGH_POINTS}
        fitted = list(reweighted(kept, _squares(kept, camera), unknowns=6 * len(kept))) if kept else []
    done = {v.id: v for v in fitted}
    return Judged(
        tuple(done.get(v.id, v) for v in views if v.id not in out),
        tuple(ViewResult(v.id, False, len(v), None, out[v.id], v.camera) for v in views if v.id in out),
    )


def _mark(views: Sequence[View], camera: Camera, loss: Loss | None, sigma: float) -> Marked:
    """Judge all points alike: a detector's sigma says nothing of what does not belong."""
    alike = [replace(v, sigma_px=None, covariance_px=None) for v in views]
    offsets = np.concatenate([[0], np.cumsum([len(v) for v in views])])
    return mark(np.sqrt(_squares(alike, camera, loss, sigma)), offsets)


def _squares(views: Sequence[View], camera: Camera, loss: Loss | None = None, sigma: float = 1.0) -> Array:
    """Squared residual norms of all points, px^2, each view at its own pose."""
    T = target_poses(camera, views, loss=loss, sigma=sigma).T_camera_target
    residuals = [v.residuals(camera, pose) for v, pose in zip(views, T)]
    return np.sum(np.concatenate(residuals) ** 2, axis=1)


def _on_a_line(view: View) -> bool:
    along, across, *_ = np.linalg.svd(view.points - view.points.mean(axis=0), compute_uv=False)
    return bool(across <= ON_A_LINE * along)


def _line_reason(view: View) -> str:
    return f"its {len(view)} points lie on a line, which determines no pose"
