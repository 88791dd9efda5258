"""Two cameras' views of one handheld target at the same moments, and the relative pose that each moment gives.

    D_m = T_a_target(m) T_b_target(m)^-1,     C_m = M_a C_a M_a^T + M_b C_b M_b^T,     L_m = [M_a L_a, M_b L_b],

C_a, C_b the covariances of the views' own poses by their cameras' noise, L_a, L_b what they are off by with their
lenses, M_a, M_b the maps of `links`. Cameras that are fixed to each other give one D.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.problem.layout import Layout
from calibrant.calibrate.cell.problem.views import HandEyeViews
from calibrant.calibrate.reprojection.factor import ReprojectionFactor, stack
from calibrant.calibrate.reprojection.links import Link, link_maps
from calibrant.cameras import Camera
from calibrant.data import View
from calibrant.geometry import se3

Moment = tuple[str, str]
"""A target's frame, and the moment."""


@dataclass(frozen=True)
class Sighting:
    """A view by its list and row."""

    list: int
    row: int


@dataclass(frozen=True, eq=False)
class Common:
    """Moments that cameras a and b share, in the order of a's views, with the sightings (n,) of each."""

    a: str
    b: str
    moments: tuple[Moment, ...]
    seen_a: tuple[Sighting, ...]
    seen_b: tuple[Sighting, ...]

    def __len__(self) -> int:
        return len(self.moments)

    def only(self, keep: Sequence[bool]) -> Common:
        """The moments where keep (n,) is true."""
        return replace(
            self,
            moments=tuple(m for m, k in zip(self.moments, keep) if k),
            seen_a=tuple(s for s, k in zip(self.seen_a, keep) if k),
            seen_b=tuple(s for s, k in zip(self.seen_b, keep) if k),
        )


def sightings(layout: Layout, data: Sequence[HandEyeViews]) -> dict[str, dict[Moment, Sighting]]:
    """By camera, where each handheld target was seen: views that are used, in their order."""
    out: dict[str, dict[Moment, Sighting]] = {camera: {} for camera in layout.cameras}
    for i, (p, d) in enumerate(zip(layout.pictures, data)):
        if p.handheld:
            frame = layout.target(p)
            out[p.camera] |= {(frame, m): Sighting(i, k) for k, (m, use) in enumerate(zip(d.ids, d.use)) if use}
    return out


def trees(layout: Layout, data: Sequence[HandEyeViews]) -> list[Common]:
    """The pairs of all cameras that see handheld targets, group by group of those that one target ties."""
    seen = sightings(layout, data)
    return [pair for group in layout.by_hand for pair in tree({c: seen[c] for c in group}, group[0])]


def tree(seen: Mapping[str, Mapping[Moment, Sighting]], root: str) -> list[Common]:
    """The pairs that lead from the root to every camera that moments connect, those with the most of them first."""
    placed, out = [root], list[Common]()
    while True:
        pairs = [(a, b) for a in placed for b in seen if b not in placed]
        if not pairs:
            return out
        a, b = max(pairs, key=lambda pair: len(seen.get(pair[0], {}).keys() & seen[pair[1]].keys()))
        best = common(seen, a, b)
        if not len(best):
            return out
        out.append(best)
        placed.append(b)


def common(seen: Mapping[str, Mapping[Moment, Sighting]], a: str, b: str) -> Common:
    """The moments that two cameras share."""
    moments = tuple(m for m in seen.get(a, {}) if m in seen[b])
    return Common(a, b, moments, tuple(seen[a][m] for m in moments), tuple(seen[b][m] for m in moments))


def poses(data: Sequence[HandEyeViews], seen: Sequence[Sighting]) -> Array:
    """T_camera_target (n, 4, 4) of these sightings."""
    return np.array([data[s.list].B[s.row] for s in seen]).reshape(-1, 4, 4)


def view_of(data: Sequence[HandEyeViews], s: Sighting) -> View:
    """The view of a sighting."""
    views = data[s.list].views
    if views is None:
        raise AssertionError("a handheld target is seen in views")  # pragma: no cover
    return views[s.row]


def pose_errors(camera: Camera, views: Sequence[View], T: Array, sigma_px: Array) -> tuple[Array, Array]:
    """What the views' own poses T (n, 4, 4) are off by: C (n, 6, 6) by their points' noise, and L (n, 6, p) by their
    lens, of unit covariance.

    C = sigma^2 A with A = (J^T J)^-1; L = -A J^T J_lens R with R R^T the lens's covariance: one error in all views.
    """
    at = np.arange(len(views))
    factor = ReprojectionFactor("views", model=camera.model, camera="lens", links=[Link("T", at)], views=stack(views))
    H = factor.blocks((np.ascontiguousarray(T), camera.values[None]), sigma=1.0).H
    A = np.linalg.pinv(H[:, :6, :6], rcond=1e-12, hermitian=True)
    C = np.square(sigma_px)[:, None, None] * A
    if camera.covariance is None:
        return C, np.zeros((len(views), 6, 1))
    values, axes = np.linalg.eigh(camera.covariance)
    root = axes * np.sqrt(np.maximum(values, 0.0))
    return C, -A @ H[:, :6, 6:] @ root


def relative(T_a: Array, T_b: Array) -> Array:
    """D (n, 4, 4)."""
    return np.asarray(T_a @ se3.inverse(T_b))


def relative_maps(T_a: Array, T_b: Array) -> tuple[Array, Array]:
    """M_a, M_b (n, 6, 6): how D answers errors of both poses, in `se3.retract`'s chart."""
    at = np.arange(len(T_a))
    M_a, M_b = link_maps([Link("a", at), Link("b", at, inverted=True)], [T_a, T_b])
    return M_a, M_b
