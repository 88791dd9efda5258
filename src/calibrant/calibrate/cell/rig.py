"""Rigs: several cameras fixed to each other that see one moving target at the same moments.

Every camera is calibrated alone; pairs of cameras that saw the target at the same moment give their relative pose,
T_a_b = T_a_target T_b_target^-1; the pairs with the most shared moments form a spanning tree that leads from the
reference camera to every other (closed-form start). Then all cameras, all relative poses and one target pose a moment
are refined together,

    min sum |project(theta_c, T_c_rig T_rig_target_m p_j) - uv|^2 / sigma_c^2,

the rig's frame being the reference camera's, the noise of every camera estimated from its residuals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.starts.medoid import robust_mean
from calibrant.calibrate.intrinsics.one_model import Kept, calibrate_keeping
from calibrant.calibrate.reprojection.factor import ReprojectionFactor, seen_in_fit
from calibrant.calibrate.reprojection.held import camera_manifold
from calibrant.calibrate.reprojection.links import Link
from calibrant.calibrate.review.review import review
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Check, Observations, ViewResult, as_transform, verdict_of
from calibrant.data.verdicts import refuse_if_failed, stamp
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3
from calibrant.optimize import (
    SE3,
    NoiseEstimate,
    Problem,
    Solution,
    SolverOptions,
    Variable,
    estimate_noise,
    uncertainty,
)

FEW_SHARED_MOMENTS = 5
"""Pairs with fewer common moments rest on single pictures: one blurred board bends the rig."""
SIGMA_FLOOR_PX = 1e-4
"""No detector comes within a hundred times of this; below it data are exact."""

NEARLY_UNDAMPED = SolverOptions(initial_damping=1e-8)
"""Each camera's own calibration starts the joint one a step from its optimum: damping only costs further steps."""


@dataclass(frozen=True, eq=False)
class Pair:
    """Two cameras that saw the target at the same moments, and their relative pose from those."""

    a: str
    b: str
    shared: int
    T_a_b: Array


@dataclass(frozen=True, eq=False)
class RigFit:
    """Every camera calibrated alone, the start that gave, and the joint fit with its noise levels."""

    reference: str
    alone: Mapping[str, Kept]
    start: RigStart
    estimate: NoiseEstimate


@dataclass(frozen=True, eq=False)
class RigStart:
    """T_camera_rig of every camera, T_rig_target (m, 4, 4) of every moment, and the pairs that led there."""

    T_camera_rig: Mapping[str, Array]
    moments: tuple[str, ...]
    T_rig_target: Array
    tree: tuple[Pair, ...]


def calibrate_rig(
    observations: Observations, *, model: str = "brown", fix: Sequence[str] = (), reference: str | None = None
) -> CalibrationResult:
    """Calibrate cameras that are fixed to each other from synchronised views; `View.moment` says what is simultaneous.

    reference: the camera whose frame is the rig's, by default the first. The result's transforms lead from it to every
    other camera (parent: reference, child: camera) with their covariance.
    Raises: InputError for unusable input; RefusedError when cameras share no moments or cannot be determined.
    """
    fit = fit_rig(observations, model=model, fix=fix, reference=reference)
    result = stamp(review(_rig_result(observations, fit, model, fix)))
    refuse_if_failed(result)
    return result


def fit_rig(
    observations: Observations, *, model: str = "brown", fix: Sequence[str] = (), reference: str | None = None
) -> RigFit:
    """The fit behind `calibrate_rig`; arguments and errors as there."""
    names = tuple(observations.image_sizes)
    if len(names) < 2:
        raise InputError(f"a rig has two cameras or more, the observations have {len(names)}: {', '.join(names)}")
    chosen = names[0] if reference is None else reference
    if chosen not in names:
        raise InputError(f"no camera {chosen!r} in the observations; known: {', '.join(names)}")
    alone = {name: calibrate_keeping(observations.of_camera(name), model=model, fix=fix) for name in names}
    start = rig_start(alone, chosen)
    estimate = estimate_noise(
        _rig_problem(alone, start, chosen, fix),
        sigmas={_group(n): max(k.result.sigma_px or 0.0, SIGMA_FLOOR_PX) for n, k in alone.items()},
        floors={_group(n): SIGMA_FLOOR_PX for n in names},
        options=NEARLY_UNDAMPED,
    )
    return RigFit(chosen, alone, start, estimate)


def _group(camera: str) -> str:
    return f"pixel {camera}"


def _frame(camera: str) -> str:
    return f"T {camera} rig"


def rig_start(alone: Mapping[str, Kept], reference: str) -> RigStart:
    """Closed-form start. Raises: RefusedError naming the cameras that share no moment with the rest."""
    poses = {name: _poses_by_moment(kept) for name, kept in alone.items()}
    T_camera_rig: dict[str, Array] = {reference: np.eye(4)}
    tree: list[Pair] = []
    while len(T_camera_rig) < len(alone):
        pair = _best_pair(poses, T_camera_rig)
        if pair is None:
            apart = ", ".join(n for n in alone if n not in T_camera_rig)
            raise RefusedError(
                f"the rig falls apart: {apart} saw the target at no moment together with {', '.join(T_camera_rig)}; "
                "take pictures in which both see the board, or check that simultaneous views carry the same moment"
            )
        T_camera_rig[pair.b] = se3.inverse(pair.T_a_b) @ T_camera_rig[pair.a]
        tree.append(pair)
    T_rig_target: dict[str, Array] = {}
    for name, by_moment in poses.items():
        # One camera's word is start enough: they differ by less than a step of the refinement.
        T = se3.inverse(T_camera_rig[name]) @ np.stack(list(by_moment.values()))
        T_rig_target = dict(zip(by_moment, T)) | T_rig_target
    moments = tuple(T_rig_target)
    return RigStart(T_camera_rig, moments, np.stack(list(T_rig_target.values())), tuple(tree))


def _poses_by_moment(kept: Kept) -> dict[str, Array]:
    """T_camera_target of every view used, by its moment."""
    return dict(zip((v.moment for v in kept.views), kept.solution.value("T_camera_target")))


def _best_pair(poses: Mapping[str, Mapping[str, Array]], placed: Mapping[str, Array]) -> Pair | None:
    """The camera not placed yet that shares the most moments with a placed one."""
    best: tuple[int, str, str, list[str]] | None = None
    for a in placed:
        for b in poses:
            if b in placed:
                continue
            shared = [m for m in poses[a] if m in poses[b]]
            if shared and (best is None or len(shared) > best[0]):
                best = (len(shared), a, b, shared)
    if best is None:
        return None
    count, a, b, shared = best
    Ta, Tb = (np.stack([poses[n][m] for m in shared]) for n in (a, b))
    return Pair(a, b, count, robust_mean(Ta @ se3.inverse(Tb)))


def _rig_problem(alone: Mapping[str, Kept], start: RigStart, reference: str, fix: Sequence[str]) -> Problem:
    place = {m: i for i, m in enumerate(start.moments)}
    variables = [Variable("T_rig_target", SE3(), start.T_rig_target, labels=start.moments, words="the target at")]
    factors = []
    for name, kept in alone.items():
        camera = kept.result.cameras[name]
        links = [Link("T_rig_target", np.array([place[v.moment] for v in kept.views]))]
        if name != reference:
            links.insert(0, Link(_frame(name), np.zeros(len(kept.views), dtype=np.int64)))
            variables.append(Variable(_frame(name), SE3(), start.T_camera_rig[name][None], words=f"camera {name}"))
        manifold = camera_manifold(camera.model, fix, camera.values)
        variables.append(Variable(name, manifold, camera.values[None], words=f"the lens of {name}"))
        factors.append(
            ReprojectionFactor(
                name, model=camera.model, camera=name, links=links, views=kept.stacked, noise=_group(name)
            )
        )
    return Problem(tuple(variables), tuple(factors))


def _rig_result(observations: Observations, fit: RigFit, model: str, fix: Sequence[str]) -> CalibrationResult:
    alone, start, estimate, reference = fit.alone, fit.start, fit.estimate, fit.reference
    solution = estimate.solution
    if solution.unobservable:
        raise RefusedError("the rig is not determined: " + "; ".join(u.message for u in solution.unobservable[:3]))
    cameras, transforms, views = {}, [], []
    squares, freedom, weighted = 0.0, 0.0, 0.0
    for name, kept in alone.items():
        before = kept.result.cameras[name]
        cameras[name] = Camera(before.model, before.image_size, solution.value(name)[0], solution.covariance(name))
        r = np.sum(solution.residuals(name) ** 2, axis=1)
        squares += float(r.sum())
        level = estimate.levels[_group(name)]
        weighted, freedom = weighted + level.sigma**2 * level.redundancy, freedom + level.redundancy
        views += _rig_views(kept, solution, name)
        if name != reference:
            T = solution.value(_frame(name))[0]
            C = uncertainty.of_inverse(T, solution.covariance(_frame(name)))
            transforms.append(as_transform(reference, name, se3.inverse(T), C))
    points = sum(len(kept.stacked.uv) for kept in alone.values())
    rms_px = float(np.sqrt(squares / points))
    checks = _checks(alone, start, estimate, rms_px)
    return CalibrationResult(
        kind="rig",
        verdict=verdict_of(checks),
        checks=checks,
        cameras=cameras,
        transforms=tuple(transforms),
        rms_px=rms_px,
        sigma_px=float(np.sqrt(weighted / freedom)),
        views=tuple(views),
        options={"model": model, "reference": reference, **({"fix": list(fix)} if fix else {})},
        observations=observations,
    )


def _rig_views(kept: Kept, solution: Solution, camera: str) -> list[ViewResult]:
    """Every view of a camera with its residual in the fit; those left out alone stay as they were."""
    fitted = {v.id: seen for v, seen in zip(kept.views, seen_in_fit(solution, camera))}
    out = []
    for view in kept.result.views:
        if view.id in fitted:
            squares, T = fitted[view.id]
            view = replace(view, rms_px=float(np.sqrt(squares.mean())), T_camera_target=T)
        out.append(view)
    return out


def _checks(alone: Mapping[str, Kept], start: RigStart, estimate: NoiseEstimate, rms_px: float) -> tuple[Check, ...]:
    solution = estimate.solution
    message = f"{solution.message} ({solution.iterations} steps, {estimate.rounds} rounds of noise levels)"
    weakest = min(start.tree, key=lambda p: p.shared)
    text = f"{weakest.a} and {weakest.b} are tied by {weakest.shared} common moments, the fewest of the rig"
    # A rig that holds adds nothing to what each camera's own fit leaves.
    own = np.sqrt(
        sum((k.result.rms_px or 0.0) ** 2 * len(k.stacked.uv) for k in alone.values())
        / sum(len(k.stacked.uv) for k in alone.values())
    )
    ratio = rms_px / own if own > 0 else 1.0
    together = f"{rms_px:.3g} px rms with the cameras fixed to each other, {own:.3g} px each for itself"
    loose = ratio > 1.5
    if loose:
        together += ": they moved against each other, or the views of a moment were not taken at once"
    return (
        Check("convergence", "ok" if solution.converged else "fail", message, float(solution.iterations)),
        Check(
            "shared-moments",
            "warn" if weakest.shared < FEW_SHARED_MOMENTS else "ok",
            text if weakest.shared >= FEW_SHARED_MOMENTS else f"{text}; {FEW_SHARED_MOMENTS} or more make it reliable",
            float(weakest.shared),
        ),
        Check("rigidity", "warn" if loose else "ok", together, float(ratio)),
    )
