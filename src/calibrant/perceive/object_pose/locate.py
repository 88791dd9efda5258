"""Where an object of known shape is: segment, table, first guesses, refinement, and what is known how well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.errors import RefusedError
from calibrant.geometry import se3
from calibrant.opencv import cv2
from calibrant.optimize import Solution
from calibrant.perceive.colour.segments import Segment
from calibrant.perceive.object_pose import fit, starts
from calibrant.perceive.object_pose.measured import FIRST_REACH, LAST_REACH, MASK_SIGMA_PX, Fitted, measured
from calibrant.perceive.object_pose.poses import ObjectPose
from calibrant.perceive.object_pose.seen import Scene, require_depth
from calibrant.perceive.object_pose.shapes import Shape
from calibrant.perceive.registered_depth.planes import Plane

CANDIDATES = 4
"""First guesses that are refined: more are turns of the same face, which refinement brings together."""
ROUNDS = 10
_LEAST_DEPTHS = 12
_FAIR_SIDE_PX = 0.15
"""By which costs are compared: an edge off by half a pixel is three of it, whatever its own sigma."""
_NO_CONTRAST = 2.0
"""What an outline costs for which a segment's stands: more than found edges that fit, less than ones that do not."""
LEAST_OVERLAP = 0.7
"""Of the drawn shape and the segment: a box of half the length overlaps by a half, one turned by 90 degrees by less."""
POOR = 2.5
"""Cost above which more is wrong than noise: that is 1, and 9 where nothing fits."""
MUCH_BETTER = 0.5
"""Of the cost: what does not stand as its shape would is believed only where that explains half of what is wrong."""
SURE = 1e-6
"""Chance below which the table contradicts what is seen of the object: of a thousand things on tables hardly one does
not stand, so that a chance of 1e-3 would be a false alarm more often than not."""
TILT_PX = 400
"""Segments of less than 20 x 20 pixels do not tell how they are tilted: 0.3 px, what sampling alone makes edges err by,
are 10 deg of foreshortening."""
LIKELY = 0.05
"""Weight of another pose, the best one's being 1, from which on it is told in words."""
RIVAL = 12.0
"""Of chi-square: a minimum that is worse by more has a weight below exp(-6) = 0.25 %."""
_STILL = 1e-3
"""Part of its sigma that a pose still moves by when it has settled."""


def locate(
    scene: Scene, segment: Segment, shape: Shape, *, others: Sequence[Segment] = (), table: Plane | None = None
) -> ObjectPose:
    """The pose T_camera_object of the shape that a segment shows, colour camera's frame.

    Args: others: further segments, which are not table; table: in the depth camera's frame, found around the segment by
    default. Raises: RefusedError where nothing tells the distance, or the shape does not fit what is seen.
    """
    notes: list[str] = []
    if table is None:
        try:
            table = scene.table(segment, others)
        except RefusedError as error:
            notes.append(f"without the table: {error}")
    inner = scene.inner(segment)
    require_depth(scene, inner, table)
    if inner.sum() < _LEAST_DEPTHS:
        notes.append(f"{int(inner.sum())} pixels on the object have depth: its distance is that of the table below it")
        inner = np.zeros_like(inner)
    if segment.on_edge:
        notes.append("the picture's edge cuts the object off: what is outside is not seen")
    guesses = _guesses(scene, segment, shape, inner, table)
    best, rivals = _best(scene, segment, shape, guesses, inner, table)
    if best.cost > POOR and _tells_tilt(best, segment):
        loose = [replace(g, contact=np.zeros((0, 3))) for g in guesses]
        other, its = _best(scene, segment, shape, loose, inner, table, afar=4)
        best, rivals = (other, its) if other.cost < MUCH_BETTER * best.cost else (best, rivals)
    best = _if_it_stands(scene, shape, best, inner, segment, notes)
    return _answer(scene, segment, shape, best, rivals, notes)


def _best(
    scene: Scene,
    segment: Segment,
    shape: Shape,
    guesses: Sequence[starts.Guess],
    inner: Mask,
    table: Plane | None,
    *,
    afar: int = 1,
) -> tuple[Fitted, list[Fitted]]:
    """The best of the guesses, refined until it stands still, and the others that noise could make the best."""
    tried = sorted((_refined(scene, segment, shape, g, inner, table, afar=afar) for g in guesses), key=lambda f: f.cost)
    best = _settled(scene, segment, shape, tried[0], inner)
    settled = [best]
    for other in tried[1:]:
        if best.cost > POOR or other.chi2 - best.chi2 < RIVAL:
            settled.append(_settled(scene, segment, shape, other, inner))
            best = min(best, settled[-1], key=lambda f: (_covers(scene, segment, shape, f) < _least(segment), f.chi2))
    near = [f for f in settled if f is not best and f.chi2 - best.chi2 < RIVAL]
    return best, [f for f in near if _covers(scene, segment, shape, f) >= _least(segment)]


def _covers(scene: Scene, segment: Segment, shape: Shape, f: Fitted) -> float:
    return starts.overlap(shape, scene.rig.colour, f.T, segment.mask)


def _least(segment: Segment) -> float:
    """Overlap of shape and segment that is asked for, where a rim of half a pixel may be the segment's or not."""
    inside = cv2.erode(segment.mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    rim = 1 - float(inside.sum()) / segment.area_px
    return LEAST_OVERLAP * (1 - 0.5 * rim)


def _guesses(scene: Scene, segment: Segment, shape: Shape, inner: Mask, table: Plane | None) -> list[starts.Guess]:
    """A few distinct guesses, best first. Raises: RefusedError where none is like the segment."""
    z = None
    if inner.any():
        p = se3.apply(scene.rig.T_colour_depth, (scene.rays * scene.registered.depth[..., None])[inner])
        z = float(np.median(p[:, 2]))
    camera = scene.rig.colour
    found = (
        starts.on_table(shape, camera, segment.mask, table.moved(scene.rig.T_colour_depth), z)
        if table is not None
        else starts.free(shape, camera, segment.mask, z or 1.0)
    )
    kept: list[starts.Guess] = []
    for g in found:
        same = (se3.deviation(k.T_camera_object, g.T_camera_object @ shape.symmetries)[1].min() < 20 for k in kept)
        if not any(same):
            kept.append(g)
        if len(kept) == CANDIDATES:
            break
    if not kept:
        raise RefusedError(f"the {shape.name} does not fit the segment ({segment.words}) in any turn; is it cut off?")
    return kept


def _refined(
    scene: Scene,
    segment: Segment,
    shape: Shape,
    guess: starts.Guess,
    inner: Mask,
    table: Plane | None,
    *,
    afar: int = 1,
) -> Fitted:
    """The pose after rounds that look far for edges, and one that looks near by."""
    T, fitted = guess.T_camera_object, None
    for k in range(afar + 1):
        reach = FIRST_REACH if k < afar else LAST_REACH
        fitted = _step(scene, segment, shape, T, inner, table, guess.contact, reach, fitted)
        T = fitted.T
    if fitted is None:
        raise ValueError("a refinement takes a round at least")
    return fitted


def _settled(scene: Scene, segment: Segment, shape: Shape, f: Fitted, inner: Mask) -> Fitted:
    """Associations and fit in turn until the pose stands still."""
    for _ in range(ROUNDS):
        new = _step(scene, segment, shape, f.T, inner, f.m.table, f.m.contact, LAST_REACH, f)
        delta = se3.local(f.T, new.T)
        f = new
        if float(delta @ np.linalg.solve(f.solution.covariance("T_camera_object"), delta)) < _STILL**2:
            break
    return f


def _step(
    scene: Scene,
    segment: Segment,
    shape: Shape,
    T: Array,
    inner: Mask,
    table: Plane | None,
    contact: Array,
    reach: float,
    before: Fitted | None,
) -> Fitted:
    m, raw, tried = measured(scene, segment, shape, T, inner, table, contact, reach, before)
    solution = fit.fit(m, shape.normals, shape.offsets, scene.rig, T, size=shape.size)
    squares, chi2 = [], 0.0
    if len(m.inverse):
        own = _mean_square(solution.residuals("depth")[:, 0] / m.sigma_inverse, len(m.inverse))
        squares.append((1 - m.lost) * own + 9.0 * m.lost)
        # Of as many depths for every pose: one that few fall upon is no better for it.
        chi2 += float(inner.sum()) / m.every * ((1 - m.lost) * own + 9.0 * m.lost / m.depth_shared)
    if tried:
        off = _outline_off(m, solution)
        squares.append(_mean_square(off, tried) + (_NO_CONTRAST if raw.min(initial=9) >= MASK_SIGMA_PX else 0.0))
        chi2 += squares[-1] * m.sides
    share = len(m.points) / max(tried, 1)
    return Fitted(solution.value("T_camera_object")[0], m, solution, float(np.mean(squares or [9.0])), chi2, share, raw)


def _mean_square(r: Array, count: int) -> float:
    """Of residuals in sigmas, cut at 3; what is missing of `count` is as bad."""
    return float((np.minimum(r * r, 9.0).sum() + 9.0 * (count - len(r))) / count)


def _outline_off(m: fit.Measurements, solution: Solution) -> Array:
    """How far edges are from the outline, in sigmas, what their side is off by included."""
    if not len(m.points):
        return np.zeros(0)
    order = np.argsort(m.side, kind="stable")
    _, counts = np.unique(m.side[order], return_counts=True)
    off = solution.residuals("outline")[:, 0] + np.repeat(solution.value("side")[:, 0], counts)
    return off / np.maximum(m.sigma_side, _FAIR_SIDE_PX)[order]


def mixture(f: Fitted, rivals: Sequence[Fitted], shape: Shape, notes: list[str]) -> Array:
    """Covariance (6, 6) about f.T of the poses that fit as well, each weighted by exp(-chi2 / 2).

    sum_i w_i (C_i + d_i d_i^T), d_i = f.T -> T_i, of the equivalent pose that is turned least against it.
    """
    out, total = f.solution.covariance("T_camera_object"), 1.0
    sigma = out
    for other in rivals:
        same = [se3.local(f.T, other.T @ S) for S in shape.symmetries]
        d = min(same, key=lambda v: float(np.linalg.norm(v[:3])))
        if float(d @ np.linalg.solve(sigma, d)) < 1.0:
            continue  # the same minimum
        w = float(np.exp(-0.5 * max(other.chi2 - f.chi2, 0.0)))
        out, total = out + w * (sigma + np.outer(d, d)), total + w
        if w > LIKELY and float(d @ np.linalg.solve(sigma, d)) > 9.0:
            turn = np.rad2deg(float(np.linalg.norm(d[:3])))
            notes.append(f"another pose fits {100 * w:.0f} % as well, turned by {turn:.0f}°: sigma spans both")
    return np.asarray(out / total)


def _if_it_stands(scene: Scene, shape: Shape, f: Fitted, inner: Mask, segment: Segment, notes: list[str]) -> Fitted:
    """The fit without the table where depth and outline contradict that the object stands on it."""
    if f.m.table is not None and not len(f.m.contact):
        notes.append("the object does not stand on the table: its pose is from depth and outline alone")
    if f.m.table is None or not _tells_tilt(f, segment):
        return f
    from scipy.stats import chi2

    loose = fit.fit(fit.without(f.m, contact=True), shape.normals, shape.offsets, scene.rig, f.T, size=shape.size)
    T = loose.value("T_camera_object")[0]
    factor = fit.StandsOn(f.m.contact)
    values = (loose.value("T_camera_object"), loose.value("table"))
    r, (J_pose, J_table) = factor.linearize(*values)
    J = np.concatenate([J_pose[:, 0], J_table[:, 0]], axis=1)
    spread = loose.joint_covariance([("T_camera_object", 0), ("table", 0)])
    covariance = J @ spread @ J.T + fit.CONTACT_SIGMA_M**2 * np.eye(len(r))
    off = float(r[:, 0] @ np.linalg.solve(covariance, r[:, 0]))
    if chi2.sf(off, 3) > SURE:
        return f
    up = f.m.table.moved(scene.rig.T_colour_depth).normal
    lowest = 1e3 * float(np.min(-r[:, 0])) if len(r) else 0.0
    notes.append(
        f"the object does not stand on the table as its shape would ({lowest:.1f} mm at its lowest corner, "
        f"{np.rad2deg(_tilt(shape, T, f.m.contact, up)):.1f}° tilted): its pose is from depth and outline alone"
    )
    guess = starts.Guess(f.T, 0.0, np.zeros((0, 3)))
    again = _refined(scene, segment, shape, guess, inner, f.m.table, afar=3)
    return _settled(scene, segment, shape, again, inner)


def _tells_tilt(f: Fitted, segment: Segment) -> bool:
    """Whether object and depth could contradict that it stands on the table."""
    on_table = f.m.table is not None and len(f.m.contact) > 0
    return on_table and len(f.m.inverse) > 0 and segment.area_px >= TILT_PX


def _tilt(shape: Shape, T: Array, contact: Array, up: Array) -> float:
    _, _, axes = np.linalg.svd(contact - contact.mean(axis=0))
    return float(np.arccos(np.clip(abs((T[:3, :3] @ axes[2]) @ up), 0, 1)))


def _answer(
    scene: Scene, segment: Segment, shape: Shape, f: Fitted, rivals: Sequence[Fitted], notes: list[str]
) -> ObjectPose:
    """Raises: RefusedError where the drawn shape is not where the segment is."""
    covers = _covers(scene, segment, shape, f)
    if covers < _least(segment):  # both are cut off by the picture's edge alike
        raise RefusedError(
            f"the {shape.name} does not fit what is seen: drawn where it fits best, it and the segment "
            f"({segment.words}) overlap by {100 * covers:.0f} %, expected {100 * _least(segment):.0f} % or more. "
            "Are its sides right, is something before it, is the depth that of this picture?"
        )
    covariance = mixture(f, rivals, shape, notes)
    covariance = covariance + fit.by_calibration(f.m, shape.normals, shape.offsets, scene.rig, f.T, size=shape.size)
    if f.cost > POOR:
        notes.append(
            f"it fits worse than noise explains (mean square {f.cost:.1f} of what is expected): look at it drawn over "
            "the picture before it is believed"
        )
    if shape.axis is not None:
        notes.append("the turn about its axis is not seen: it is a surface of revolution")
    if len(f.m.points) and f.raw_sigma.min() >= MASK_SIGMA_PX:
        notes.append("its edges have no contrast in the picture: the segment's outline stands for them")
    figures = {
        "overlap": covers,
        "edges": f.edges_found,
        "edge_sigma_px": float(np.median(f.m.sigma_edge)) if len(f.m.points) else np.nan,
        "depth_sigma_mm": 1e3 * f.m.sigma_inverse * float(f.T[2, 3]) ** 2,
        "depths": float(len(f.m.inverse)),
        "faces": float(len(np.unique(np.round(shape.normals[f.m.face], 3), axis=0))) if len(f.m.face) else 0.0,
        "misfit": f.cost,
        "centre_u_px": float(segment.centre[0]),
        "centre_v_px": float(segment.centre[1]),
        "area_px": float(segment.area_px),
    }
    unknown = fit.undetermined(covariance, shape.size)
    return ObjectPose(shape.name, f.T, covariance, shape.symmetries, unknown, tuple(notes), figures)
