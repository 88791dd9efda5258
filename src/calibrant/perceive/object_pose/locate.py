"""Where an object of known shape is: segment, table, first guesses, refinement, and what is known how well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Mask
from calibrant.errors import RefusedError
from calibrant.geometry import se3
from calibrant.opencv import cv2
from calibrant.optimize import Solution
from calibrant.perceive.colour.segments import Segment
from calibrant.perceive.object_pose import fit, starts
from calibrant.perceive.object_pose.edge_profiles import REACH_PX, measure_edges
from calibrant.perceive.object_pose.outline_edges import COMMON_BIAS_PX, find_edges, side_bias, with_their_side
from calibrant.perceive.object_pose.poses import ObjectPose
from calibrant.perceive.object_pose.rendered import Silhouette, outline, visible_triangles
from calibrant.perceive.object_pose.seen import RIM_PX, Scene, require_depth
from calibrant.perceive.object_pose.shapes import Shape
from calibrant.perceive.registered_depth.planes import Plane
from calibrant.perceive.registered_depth.steps import mean_rounding

CANDIDATES = 4
"""First guesses that are refined: more are turns of the same face, which refinement brings together."""
ROUNDS = 6
_FIRST_REACH = 8.0
_LAST_REACH = REACH_PX
"""Pixels: at first half a step of the guesses' turn at the rim of a segment of 100 pixels; then what blur needs."""
_MOST_DEPTHS = 4000
_FAR = 4.0
"""Sigmas: a depth farther off belongs to something else; 1 of 16 000 good ones is lost."""
_LEAST_DEPTHS = 12
_LEAST_EDGES = 4
_LEAST_SHARE = 0.3
"""Of the outline: fewer edges may be those of something else."""
_FIRST_SIGMA_PX = 0.5
_MASK_SIGMA_PX = 1.5
"""Of a segment's outline: specks are opened and gaps closed by a pixel or two."""
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
_STILL = 1e-3
"""Part of its sigma that a pose still moves by when it has settled."""


@dataclass(frozen=True, eq=False)
class _Fitted:
    """A refined pose with its measurements. cost: mean squared residual in sigmas, cut at 3, misses counted as 3."""

    T: Array
    m: fit.Measurements
    solution: Solution
    cost: float
    edges_found: float
    raw_sigma: Array


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
    best = min((_refined(scene, segment, shape, g, inner, table) for g in guesses), key=lambda f: f.cost)
    if best.cost > POOR and _tells_tilt(best, segment):
        loose = (replace(g, contact=np.zeros((0, 3))) for g in guesses)
        other = min((_refined(scene, segment, shape, g, inner, table, afar=4) for g in loose), key=lambda f: f.cost)
        best = other if other.cost < MUCH_BETTER * best.cost else best
    best = _settled(scene, segment, shape, best, inner)
    best = _if_it_stands(scene, shape, best, inner, segment, notes)
    return _answer(scene, segment, shape, best, notes)


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
) -> _Fitted:
    """The pose after rounds that look far for edges, and one that looks near by."""
    T, fitted = guess.T_camera_object, None
    for k in range(afar + 1):
        reach = _FIRST_REACH if k < afar else _LAST_REACH
        fitted = _step(scene, segment, shape, T, inner, table, guess.contact, reach, fitted)
        T = fitted.T
    if fitted is None:
        raise ValueError("a refinement takes a round at least")
    return fitted


def _settled(scene: Scene, segment: Segment, shape: Shape, f: _Fitted, inner: Mask) -> _Fitted:
    """Associations and fit in turn until the pose stands still."""
    for _ in range(ROUNDS):
        new = _step(scene, segment, shape, f.T, inner, f.m.table, f.m.contact, _LAST_REACH, f)
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
    before: _Fitted | None,
) -> _Fitted:
    m, raw, tried = _measured(scene, segment, shape, T, inner, table, contact, reach, before)
    solution = fit.fit(m, shape.normals, shape.offsets, scene.rig, T, size=shape.size)
    names = [f.name for f in solution.problem.factors]
    squares = []
    for name, count in (("depth", len(m.inverse)), ("outline", tried)):
        if count:
            r = solution.residuals(name)[:, 0] if name in names else np.zeros(0)
            sigma = m.sigma_inverse if name == "depth" else np.median(m.sigma_edge) if len(r) else 1.0
            s = np.minimum((r / sigma) ** 2, 9.0)
            squares.append(float((s.sum() + 9.0 * (count - len(s))) / count))
    share = len(m.points) / max(tried, 1)
    return _Fitted(solution.value("T_camera_object")[0], m, solution, float(np.mean(squares or [9.0])), share, raw)


def _measured(
    scene: Scene,
    segment: Segment,
    shape: Shape,
    T: Array,
    inner: Mask,
    table: Plane | None,
    contact: Array,
    reach: float,
    before: _Fitted | None,
) -> tuple[fit.Measurements, Array, int]:
    """What belongs to the object if it stands at T; the edges' own sigmas; and how many edges were looked for."""
    noise = scene.noise if table is None else table.noise
    uv, inverse, face, every = _depths(scene, shape, T, inner, noise.inverse_sigma if before else np.inf)
    seen = outline(shape, scene.rig.colour, T, visible_triangles(shape, scene.rig.colour, T))
    seen = _unhidden(scene, T, seen)
    edge, edge_uv, edge_sigma, tried = _edges(scene, segment, seen, reach)
    depth_sigma, worse = _levels(before, noise.inverse_sigma)
    shared = max(noise.pixels_per_sample / every, 1.0)
    m = fit.Measurements(
        uv_depth=uv,
        inverse=inverse,
        face=face,
        sigma_inverse=depth_sigma * shared**0.5,
        points=seen.points[edge],
        outward=seen.outward[edge],
        edge_uv=edge_uv,
        side=seen.side[edge],
        sigma_edge=worse * edge_sigma,
        sigma_side=side_bias(seen.strips[edge], 2 * REACH_PX),
        sigma_common=COMMON_BIAS_PX,
        contact=contact if table is not None else np.zeros((0, 3)),
        table=table,
        scale_sigma=noise.common_scale(float(T[2, 3])),
        rounding=mean_rounding(scene.registered.depth, inverse, table.step if table is not None else None),
    )
    return m, edge_sigma, tried


def _edges(
    scene: Scene, segment: Segment, seen: Silhouette, reach: float
) -> tuple[NDArray[np.int64], Array, Array, int]:
    """Samples of the outline that have an edge (k,), where (k, 2), sigma (k,), px; and how many were looked for.

    From afar every sample's half-way point; near by, what `edge_profiles` makes of pieces.
    """
    if reach > _LAST_REACH:
        edges = find_edges(scene.colour, seen, reach=min(reach, max(segment.box[2:]) / 4))
        sample, off, asked = np.flatnonzero(edges.good), edges.off[edges.good], len(seen.points)
        sigma = np.full(len(sample), _FIRST_SIGMA_PX)
    else:
        pieces = measure_edges(scene.colour, seen)
        sample, off, sigma, asked = pieces.sample, pieces.off, pieces.sigma, pieces.asked
        good = with_their_side(off, np.ones(len(off), dtype=np.bool_), seen.side[sample])
        sample, off, sigma = sample[good], off[good], sigma[good]
    if len(sample) < max(_LEAST_EDGES, _LEAST_SHARE * asked):
        # The picture has no contrast there: what cut the segment out is all there is.
        edges = find_edges(np.where(segment.mask, 255.0, 0.0).astype(np.float32), seen, reach=_FIRST_REACH)
        sample, off, asked = np.flatnonzero(edges.good), edges.off[edges.good], len(seen.points)
        sigma = np.full(len(sample), _MASK_SIGMA_PX)
    return sample, seen.uv[sample] + off[:, None] * seen.outward[sample], sigma, asked


def _depths(
    scene: Scene, shape: Shape, T: Array, inner: Mask, sigma: float
) -> tuple[Array, Array, NDArray[np.int64], float]:
    """Pixels (n, 2), 1/z and faces of the depths on the object; and of how many pixels each stands for."""
    T_depth = se3.inverse(scene.rig.T_colour_depth) @ T
    index = visible_triangles(shape, scene.rig.depth, T_depth)
    size = 2 * RIM_PX + 1
    whole = cv2.erode((index >= 0).astype(np.uint8), np.ones((size, size), np.uint8)) > 0
    rows, columns = np.nonzero(inner & whole)
    face = index[rows, columns]
    q = 1 / scene.registered.depth[rows, columns]
    R, t = T_depth[:3, :3], T_depth[:3, 3]
    n = shape.normals[face] @ R.T
    off = np.sum(n * scene.rays[rows, columns], axis=1) / (shape.offsets[face] + n @ t) - q
    if len(off):
        # The guess may be off as a whole: gross errors are told from the others' median.
        middle = float(np.median(off))
        spread = float(np.median(np.abs(off - middle))) / 0.6745
        limit = _FAR * max(spread, sigma if np.isfinite(sigma) else scene.noise.inverse_sigma)
        near = np.abs(off - middle) <= limit
        rows, columns, face, q = rows[near], columns[near], face[near], q[near]
    every = max(len(rows) / _MOST_DEPTHS, 1.0)
    pick = np.unique(np.linspace(0, len(rows) - 1, min(len(rows), _MOST_DEPTHS)).astype(np.int64))
    uv = np.stack([columns, rows], axis=1).astype(np.float64)
    return uv[pick], q[pick], face[pick], every


def _unhidden(scene: Scene, T: Array, seen: Silhouette) -> Silhouette:
    """The samples beside which nothing stands in front of the object."""
    if not len(seen.uv):
        return seen
    z = scene.registered.z
    height, width = z.shape
    at = np.rint(seen.uv + 2 * RIM_PX * seen.outward).astype(np.int64)
    at = np.clip(at, 0, (width - 1, height - 1))
    beside = z[at[:, 1], at[:, 0]]
    own = se3.apply(T, seen.points)[:, 2]
    with np.errstate(invalid="ignore"):
        hidden = beside < own - 5 * scene.noise.sigma_z(own) - 0.1 * np.ptp(own) - 0.01 * own
    return seen.only(~hidden)


def _levels(before: _Fitted | None, inverse_sigma: float) -> tuple[float, float]:
    """Noise of a depth on the object, 1/m, and by how much edges are worse than they say, by what the fit before left
    over."""
    if before is None:
        return inverse_sigma, 1.0
    names = [f.name for f in before.solution.problem.factors]
    depth, worse = inverse_sigma, 1.0
    if "depth" in names:
        r = before.solution.residuals("depth")[:, 0]
        depth = max(inverse_sigma, float(np.median(np.abs(r))) / 0.6745)
    if "outline" in names:
        order = np.argsort(before.m.side, kind="stable")
        r = before.solution.residuals("outline")[:, 0] / before.raw_sigma[order]
        worse = max(1.0, float(np.median(np.abs(r))) / 0.6745)
    return depth, worse


def _if_it_stands(scene: Scene, shape: Shape, f: _Fitted, inner: Mask, segment: Segment, notes: list[str]) -> _Fitted:
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


def _tells_tilt(f: _Fitted, segment: Segment) -> bool:
    """Whether object and depth could contradict that it stands on the table."""
    on_table = f.m.table is not None and len(f.m.contact) > 0
    return on_table and len(f.m.inverse) > 0 and segment.area_px >= TILT_PX


def _tilt(shape: Shape, T: Array, contact: Array, up: Array) -> float:
    _, _, axes = np.linalg.svd(contact - contact.mean(axis=0))
    return float(np.arccos(np.clip(abs((T[:3, :3] @ axes[2]) @ up), 0, 1)))


def _answer(scene: Scene, segment: Segment, shape: Shape, f: _Fitted, notes: list[str]) -> ObjectPose:
    """Raises: RefusedError where the drawn shape is not where the segment is."""
    covers = starts.overlap(shape, scene.rig.colour, f.T, segment.mask)
    if covers < LEAST_OVERLAP and not segment.on_edge:
        raise RefusedError(
            f"the {shape.name} does not fit what is seen: drawn where it fits best, it and the segment "
            f"({segment.words}) overlap by {100 * covers:.0f} %, expected {100 * LEAST_OVERLAP:.0f} % or more. "
            "Are its sides right, is something before it, is the depth that of this picture?"
        )
    covariance = f.solution.covariance("T_camera_object")
    covariance = covariance + fit.by_calibration(f.m, shape.normals, shape.offsets, scene.rig, f.T, size=shape.size)
    if shape.axis is not None:
        notes.append("the turn about its axis is not seen: it is a surface of revolution")
    if len(f.m.points) and f.raw_sigma.min() >= _MASK_SIGMA_PX:
        notes.append("its edges have no contrast in the picture: the segment's outline stands for them")
    figures = {
        "overlap": covers,
        "edges": f.edges_found,
        "edge_sigma_px": float(np.median(f.m.sigma_edge)) if len(f.m.points) else np.nan,
        "depth_sigma_mm": 1e3 * f.m.sigma_inverse * float(f.T[2, 3]) ** 2,
        "depths": float(len(f.m.inverse)),
        "faces": float(len(np.unique(np.round(shape.normals[f.m.face], 3), axis=0))) if len(f.m.face) else 0.0,
        "centre_u_px": float(segment.centre[0]),
        "centre_v_px": float(segment.centre[1]),
        "area_px": float(segment.area_px),
    }
    unknown = fit.undetermined(covariance, shape.size)
    return ObjectPose(shape.name, f.T, covariance, shape.symmetries, unknown, tuple(notes), figures)
