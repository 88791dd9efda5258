"""The pairs of views that two cameras took at once: where one stands to the other by each, and which contradict it.

A pair is apart where d_m^T C_m^-1 d_m, d_m = local(D, D_m), is beyond chance, scaled by the median as in `consistency`,
and would raise the pair's own noise to `NOISIER` times: below that a common pose costs less than leaving the pair out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array, Mask
from calibrant.calibrate.cell.moments.late import distances, scatter
from calibrant.calibrate.cell.moments.sightings import (
    Common,
    Sighting,
    pose_errors,
    poses,
    relative,
    relative_maps,
    view_of,
)
from calibrant.calibrate.cell.moments.swept import swept
from calibrant.calibrate.cell.problem.camera_role import CameraRole
from calibrant.calibrate.cell.problem.views import HandEyeViews
from calibrant.calibrate.cell.starts.medoid import robust_mean
from calibrant.geometry import se3
from calibrant.optimize.chances import CHI2_6_LIMIT, CHI2_6_MEDIAN

NOISIER = 1.5
"""A pair's noise with the common place over its own, from which it is no pair: as for a camera among others."""
LEAST = 3
"""Pairs that can outvote one."""
PAIRED = 0.25
"""Scatter of pairs over that of any views: views that have nothing to do with each other come to about one, half of
them that do to a quarter at most."""
_TRIED = 60
"""Places that are tried as the one that most agree on."""
PairKey = tuple[str, tuple[Sighting, ...]]
PairErrors = tuple[Array, Array]
"""C and L of a camera's sightings (`sightings.pose_errors`)."""


@dataclass(frozen=True, eq=False)
class PairPoses:
    """T_a, T_b (n, 4, 4) of the moments of a pair with what they are off by (`sightings.pose_errors`): C_a, C_b
    (n, 6, 6), L_a, L_b (n, 6, p); freedom (n,): residuals of both views beyond their poses; names_a, names_b: the
    views' ids."""

    T_a: Array
    T_b: Array
    C_a: Array
    C_b: Array
    L_a: Array
    L_b: Array
    freedom: Array
    names_a: tuple[str, ...]
    names_b: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.T_a)

    @property
    def D(self) -> Array:
        """Where b stands to a, by each moment."""
        return relative(self.T_a, self.T_b)

    @property
    def errors(self) -> tuple[Array, Array]:
        """C (n, 6, 6) and L (n, 6, p) of each D."""
        M_a, M_b = relative_maps(self.T_a, self.T_b)
        C = M_a @ self.C_a @ np.swapaxes(M_a, 1, 2) + M_b @ self.C_b @ np.swapaxes(M_b, 1, 2)
        return C, np.concatenate([M_a @ self.L_a, M_b @ self.L_b], axis=2)

    def take(self, a: ArrayLike, b: ArrayLike) -> PairPoses:
        """Other pairs: views a of the first camera with views b of the second."""
        i, j = np.asarray(a, dtype=np.intp), np.asarray(b, dtype=np.intp)
        half = 0.5 * self.freedom
        return PairPoses(
            *(self.T_a[i], self.T_b[j], self.C_a[i], self.C_b[j], self.L_a[i], self.L_b[j]),
            half[i] + half[j],
            tuple(self.names_a[k] for k in i.tolist()),
            tuple(self.names_b[k] for k in j.tolist()),
        )


def pair_poses(
    pair: Common,
    data: Sequence[HandEyeViews],
    roles: Mapping[str, CameraRole],
    times: Mapping[str, float],
    known: dict[PairKey, PairErrors],
) -> PairPoses:
    """The poses of a pair's views, each with what its noise, its lens and, where times are known, its clock leave
    uncertain. known: what such sightings of these data are off by, as far as it was asked; most pairs have one camera.
    """
    T, C, L, views = [], [], [], []
    for name, seen in ((pair.a, pair.seen_a), (pair.b, pair.seen_b)):
        T.append(poses(data, seen))
        views.append([view_of(data, s) for s in seen])
        if (name, seen) not in known:
            sigma = np.array([data[s.list].sigma_px for s in seen])
            known[name, seen] = pose_errors(roles[name].camera, views[-1], T[-1], sigma)
        by_noise, by_lens = known[name, seen]
        C.append(by_noise)
        L.append(by_lens)
    by_jitter, late = swept([data[s.list].ids[s.row] for s in pair.seen_b], T[1], times)
    if by_jitter.any():
        C[1] = C[1] + by_jitter
        L[1] = np.concatenate([L[1], late[:, :, None]], axis=2)
    freedom = np.array([max(2 * len(a) + 2 * len(b) - 12, 1) for a, b in zip(*views)], dtype=np.float64)
    names_a, names_b = (tuple(v.id for v in seen) for seen in views)
    return PairPoses(T[0], T[1], C[0], C[1], L[0], L[1], freedom, names_a, names_b)


def off(found: PairPoses, D: Array) -> Array:
    """d^T C^-1 d (n,) of every pair against a common place."""
    own, (C, L) = found.D, found.errors
    d = se3.local(np.broadcast_to(D, own.shape), own)
    return np.einsum("ni,ni->n", d, np.linalg.solve(C + L @ np.swapaxes(L, 1, 2), d[..., None])[..., 0])


def apart(found: PairPoses, D: Array) -> Mask:
    """Pairs (n,) that contradict a common place D."""
    statistic = off(found, D)
    noisier = np.sqrt(1 + statistic / found.freedom) > NOISIER
    if not noisier.any():
        return noisier  # and nothing asks what the others say
    # What boards, lenses and clocks have in common moves all pairs; those that are none say nothing of it.
    any_views = _scatter_of_any(found)
    pairs = len(found) >= LEAST and scatter(found.D) < PAIRED * any_views
    telling = distances(found.D, D) < PAIRED * any_views if pairs else ~noisier
    scale = max(float(np.median(statistic[telling])) / CHI2_6_MEDIAN, 1.0) if telling.any() else 1.0
    return np.asarray((statistic / scale > CHI2_6_LIMIT) & noisier)


def _scatter_of_any(found: PairPoses) -> float:
    """How far the same views are from agreeing in another order. Pairs that agree far better are pairs, however little
    they agree; one as far from their place is none, whatever the others are."""
    n = len(found)
    return scatter(found.take(range(n), np.roll(np.arange(n), n // 2)).D) if n >= LEAST else 0.0


def agreed_place(found: PairPoses) -> Array:
    """The place (4, 4) that the most pairs agree on, also where less than half of them do.

    Each pair's own place is tried; of as many that agree the one about which they lie closest. What they have in common
    of their lenses' errors moves all alike and is no part of how close they must be to each other.
    """
    D = found.D
    tried = range(0, len(D), max(1, len(D) // _TRIED))
    limit = found.freedom * (NOISIER**2 - 1)
    ways = [np.sqrt(off(found, D[k]) / limit) for k in tried]
    best = min(ways, key=lambda way: (-int((way <= 1).sum()), float(np.sum(np.minimum(way, 1)))))
    return np.asarray(se3.mean(D[best <= 1])) if (best <= 1).sum() > 1 else robust_mean(D)
