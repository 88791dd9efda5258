"""Errors of a robot's own geometry: how large they are by what the fit left, and how large they could be unseen.

Links, zeros of joints, gears, sag err smoothly over the whole work: `accuracy.geometry_field`, here alike over the
flange's whole distance from the base and two radians, since one joint turns by a part of what the flange turns
(simulated arms are a thousand times likelier by it than by half of it). Most of such a pattern the unknowns take; what
is left is small in each pose, and alike in all. With E the field of an arm that errs by a metre and z = E^T g of
covariance M + v M^2, as in `neighbours`, an error of variance v is

    L = |I + v M|^-1/2 exp(v z^T (I + v M)^-1 z / 2)

times as likely as none. Before the data an arm errs or not, alike; every level of `LEVELS` is in units of what the
poses tell v to. What it moves is added to the covariance, averaged over what the data leave possible. The largest v
that they do not contradict says what the errors could be; only the arm's accuracy or its joints say less.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.certainty.accuracy import geometry_field
from calibrant.calibrate.cell.certainty.pose_errors import PoseErrors

ODDS = 1.0
"""Errors that show before the data: as likely as not."""
LEVELS = (4.0, 16.0, 64.0, 256.0, 1024.0)
"""Variance over what the poses tell one pattern to. At less than four times that nothing shows, and sigma would grow
where there is nothing."""
REACH, RADIANS = 1.0, 2.0
"""Over what errors go: shares of the flange's distance from the base, and angles."""
CONTRADICTED = 1.92
"""Fall of log L at the end of a 95 % interval: half of chi-square's 3.84."""
TYPICAL = 0.65e-3
"""Metres, where the data tell less: linear accuracy of an ABB IRB 1600 as delivered (Slamani, Nubiola and Bonev 2012,
"Assessment of the positioning performance of an industrial robot", Industrial Robot 39, 57-68)."""
_FINEST, _STEPS = 1e-2, 80
_NOT_SEEN = 1e-9
"""Share of the best seen pattern below which one is not seen: rounding."""


@dataclass(frozen=True, eq=False)
class GeometryErrors:
    """covariance (s, s): what is added to that of the shared unknowns; chance: that there are any; metres: their rms at
    the flange, in the covariance.

    unseen: rms, metres, of what else they could be; assumed: whether that is `TYPICAL`, since the poses exclude no more
    and show less; moved (s, k):
    what patterns of a metre do to the shared unknowns.
    """

    covariance: Array
    chance: float
    metres: float
    unseen: float
    assumed: bool
    moved: Array

    @property
    def could_add(self) -> Array:
        """Covariance (s, s) of what is not seen and could be."""
        return np.asarray(self.unseen**2 * self.moved @ self.moved.T)


def geometry_errors(errors: PoseErrors) -> GeometryErrors | None:
    """What the poses say of the robot's geometry; None where no pattern shows in them at all."""
    E = geometry_field(errors.T_base_gripper, reach=REACH, radians=RADIANS)
    n, s, _ = errors.pull.shape
    flat = E.reshape(6 * n, -1)
    pulled = np.swapaxes(errors.pull, 1, 2).reshape(6 * n, s).T @ flat
    M = flat.T @ (errors.information @ E).reshape(6 * n, -1) - pulled.T @ errors.covariance @ pulled
    seen, axes = np.linalg.eigh(M)
    z = axes.T @ (flat.T @ errors.gradient.ravel())
    keep = seen > _NOT_SEEN * max(float(seen[-1]), 0.0)
    if not keep.any():
        return None
    seen, z = seen[keep], z[keep]
    unit = float(np.sum(seen) / np.sum(seen**2))
    levels = unit * np.array(LEVELS)
    odds = np.log(ODDS / len(levels)) + _log_likelihoods(seen, z, levels)
    top = max(float(odds.max()), 0.0)
    weight = np.exp(odds - top) / (np.exp(-top) + np.exp(odds - top).sum())
    held = float(weight @ levels)
    limit = _limit(seen, z, unit)
    could, shown = float(np.sqrt(max(limit - held, 0.0))), float(np.sqrt(held))
    assumed = shown < TYPICAL < could
    moved = -errors.covariance @ pulled
    return GeometryErrors(
        held * moved @ moved.T,
        float(weight.sum()),
        shown,
        TYPICAL if assumed else could,
        assumed,
        moved,
    )


def _log_likelihoods(seen: Array, z: Array, levels: Array) -> Array:
    """log L of every level, from the eigenvalues of M and z along its axes."""
    v = levels[:, None]
    return np.asarray(0.5 * np.sum(v * z**2 / (1 + v * seen) - np.log1p(v * seen), axis=1))


def _limit(seen: Array, z: Array, unit: float) -> float:
    """The largest level that the data do not contradict."""
    levels = unit * np.geomspace(_FINEST, LEVELS[-1] ** 2, _STEPS)
    logs = _log_likelihoods(seen, z, levels)
    possible = np.flatnonzero(logs > max(float(logs.max()), 0.0) - CONTRADICTED)
    return float(levels[possible[-1]]) if len(possible) else 0.0
