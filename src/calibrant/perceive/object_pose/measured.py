"""What belongs to an object if it stands where a pose says: depths on its faces, edges along its outline.

Associations are made anew for every pose: which triangle a pixel of depth sees, and which edge of the picture is the
outline's. What a fit left over tells how noisy both are on this object.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Mask
from calibrant.geometry import se3
from calibrant.opencv import cv2
from calibrant.optimize import Solution
from calibrant.perceive.colour.segments import Segment
from calibrant.perceive.object_pose import fit
from calibrant.perceive.object_pose.edge_profiles import REACH_PX, measure_edges
from calibrant.perceive.object_pose.outline_edges import (
    COMMON_BIAS_PX,
    find_edges,
    sampling_bias,
    side_bias,
    with_their_side,
)
from calibrant.perceive.object_pose.rendered import SPACING_PX, Silhouette, outline, visible_triangles
from calibrant.perceive.object_pose.seen import RIM_PX, Scene
from calibrant.perceive.object_pose.shapes import Shape
from calibrant.perceive.registered_depth.planes import Plane
from calibrant.perceive.registered_depth.steps import mean_rounding

FIRST_REACH = 8.0
LAST_REACH = REACH_PX
"""Pixels: at first half a step of the guesses' turn at the rim of a segment of 100 pixels; then what blur needs."""
_MOST_DEPTHS = 4000
_FAR = 4.0
"""Sigmas: a depth farther off belongs to something else; 1 of 16 000 good ones is lost."""
_LEAST_EDGES = 4
_LEAST_SHARE = 0.3
"""Of the outline: fewer edges may be those of something else."""
_FIRST_SIGMA_PX = 0.5
MASK_SIGMA_PX = 1.5
"""Of a segment's outline: specks are opened and gaps closed by a pixel or two."""
WORST = 3.0
"""By how much edges may be worse than they say: farther off they are not noisy but of something else, and less weight
would make them follow whatever else there is."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """A refined pose with its measurements. cost: mean squared residual in sigmas, cut at 3, misses counted as 3;
    chi2: their sum over what is independent: sides of the outline, windows of depth."""

    T: Array
    m: fit.Measurements
    solution: Solution
    cost: float
    chi2: float
    edges_found: float
    raw_sigma: Array


def measured(
    scene: Scene,
    segment: Segment,
    shape: Shape,
    T: Array,
    inner: Mask,
    table: Plane | None,
    contact: Array,
    reach: float,
    before: Fitted | None,
) -> tuple[fit.Measurements, Array, int]:
    """What belongs to the object if it stands at T; the edges' own sigmas; and how many edges were looked for."""
    noise = scene.noise if table is None else table.noise
    uv, inverse, face, every, lost = _depths(scene, shape, T, inner, noise.inverse_sigma if before else np.inf)
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
        sigma_side=_sides(seen, scene.staircase)[edge],
        sigma_common=COMMON_BIAS_PX,
        contact=contact if table is not None else np.zeros((0, 3)),
        table=table,
        scale_sigma=noise.common_scale(float(T[2, 3])),
        rounding=mean_rounding(scene.registered.depth, inverse, table.step if table is not None else None),
        lost=lost,
        depth_shared=shared,
        every=every,
        sides=len(np.unique(seen.side)),
    )
    return m, edge_sigma, tried


def _sides(seen: Silhouette, staircase: float) -> Array:
    """Sigma (n,), px, of what each sample's side is off by as a whole."""
    _, first, side, count = np.unique(seen.side, return_index=True, return_inverse=True, return_counts=True)
    if not len(side):
        return np.zeros(0)
    total = np.stack([np.bincount(side, weights=seen.outward[:, k]) for k in (0, 1)], axis=1)
    size = np.linalg.norm(total, axis=1, keepdims=True)
    along = np.where(size > 0, total / np.maximum(size, 1e-12), seen.outward[first])
    grid = sampling_bias(along, SPACING_PX * count.astype(np.float64), staircase)
    return np.hypot(side_bias(seen.strips, 2 * REACH_PX), grid[side])


def _edges(
    scene: Scene, segment: Segment, seen: Silhouette, reach: float
) -> tuple[NDArray[np.int64], Array, Array, int]:
    """Samples of the outline that have an edge (k,), where (k, 2), sigma (k,), px; and how many were looked for.

    From afar every sample's half-way point; near by, what `edge_profiles` makes of pieces.
    """
    if reach > LAST_REACH:
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
        edges = find_edges(np.where(segment.mask, 255.0, 0.0).astype(np.float32), seen, reach=FIRST_REACH)
        sample, off, asked = np.flatnonzero(edges.good), edges.off[edges.good], len(seen.points)
        sigma = np.full(len(sample), MASK_SIGMA_PX)
    return sample, seen.uv[sample] + off[:, None] * seen.outward[sample], sigma, asked


def _depths(
    scene: Scene, shape: Shape, T: Array, inner: Mask, sigma: float
) -> tuple[Array, Array, NDArray[np.int64], float, float]:
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
    lost = 0.0
    if len(off):
        # The guess may be off as a whole: gross errors are told from the others' median.
        middle = float(np.median(off))
        spread = float(np.median(np.abs(off - middle))) / 0.6745
        limit = _FAR * max(spread, sigma if np.isfinite(sigma) else scene.noise.inverse_sigma)
        near = np.abs(off - middle) <= limit
        rows, columns, face, q = rows[near], columns[near], face[near], q[near]
        lost = 1 - float(near.mean())
    every = max(len(rows) / _MOST_DEPTHS, 1.0)
    pick = np.unique(np.linspace(0, len(rows) - 1, min(len(rows), _MOST_DEPTHS)).astype(np.int64))
    uv = np.stack([columns, rows], axis=1).astype(np.float64)
    return uv[pick], q[pick], face[pick], every, lost


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


def _levels(before: Fitted | None, inverse_sigma: float) -> tuple[float, float]:
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
        worse = min(max(1.0, float(np.median(np.abs(r))) / 0.6745), WORST)
    return depth, worse
