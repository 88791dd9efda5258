"""Errors that neighbouring poses share: how likely they are by what the fit left, and what they do to its result.

A robot's geometry, its drift, a detector's habits err alike at poses that follow each other or lie near each other.
With e = F b (`alike`), b of variance v in units of a pose's own noise, the gradients of `pose_errors` become z = F^T g
with covariance M + v M^2, M that of independent errors. Against none, v = 0, the likelihood is

    L = |I + v M|^-1/2 exp(v z^T (I + v M)^-1 z / 2),

the part that all unknowns have taken being in M already: what cannot be seen, says nothing. Before the data, shared
errors are as likely as none (`ODDS`), every pattern and level of `LEVELS` alike; what they add to the covariance is
averaged over what the data leave possible. A threshold would add nothing below, where most of a dozen poses are, and
independent errors make sigma a twentieth larger.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.certainty.alike import by_order, by_place
from calibrant.calibrate.cell.certainty.pose_errors import PoseErrors

ODDS = 1.0
"""Shared errors before the data: as likely as not."""
LEVELS = (1.0, 4.0, 16.0)
"""Variance of what is shared over that of a pose's own: as much, and up to four times the size, of which the fit has
taken most. Smaller ones add little."""
PLACES = (2.0, 5.0, 15.0)
"""Lengths in the order of the poses, threefold apart: from pairs to the whole of most sets."""
SPREADS = (1.0, 2.0)
"""Lengths in the poses' own spread: shorter ones are not told from independent errors by as many poses."""
LEAST_POSES = 4


@dataclass(frozen=True, eq=False)
class NeighbourErrors:
    """covariance (s, s): what errors that neighbours share add to that of the shared unknowns; chance: that there are
    any; order: that of it where they go by the order of the poses, and not by their places."""

    covariance: Array
    chance: float
    order: float


def shared_errors(errors: PoseErrors) -> NeighbourErrors | None:
    """What the errors of these poses share; None for too few of them."""
    if len(errors.gradient) < LEAST_POSES:
        return None
    found = list(_patterns(errors))
    log_odds = np.array([np.log(ODDS / (len(found) * len(LEVELS))) + p.log_likelihoods for p in found])
    top = max(float(log_odds.max()), 0.0)
    weight = np.exp(log_odds - top) / (np.exp(-top) + np.exp(log_odds - top).sum())
    covariance = np.sum([w @ np.array(LEVELS) * p.moved @ p.moved.T for w, p in zip(weight, found)], axis=0)
    order = float(sum(w.sum() for w, p in zip(weight, found) if p.of_order))
    return NeighbourErrors(covariance, float(weight.sum()), order)


@dataclass(frozen=True, eq=False)
class _Pattern:
    of_order: bool
    log_likelihoods: Array
    moved: Array


def _patterns(errors: PoseErrors) -> Iterator[_Pattern]:
    T = errors.T_base_gripper
    n = len(T)
    t, R = T[:, :3, 3], T[:, :3, :3].reshape(n, 9)
    # |R_a - R_b|^2 is twice the square of a small angle.
    spread = [float(np.sqrt(np.sum((x - x.mean(axis=0)) ** 2) / n)) for x in (t, R / np.sqrt(2))]
    roots = [(True, by_order(n, length)) for length in PLACES]
    if all(spread):
        roots += [(False, by_place(T, metres=k * spread[0], radians=k * spread[1])) for k in SPREADS]
    for of_flange in (True, False):
        L = errors.units(of_flange=of_flange)
        own, pull = np.einsum("nab,na->nb", L, errors.gradient), errors.pull @ L
        for of_order, F in roots:
            yield _pattern(errors, own, pull, F, of_order=of_order)


def _pattern(errors: PoseErrors, own: Array, pull: Array, F: Array, *, of_order: bool) -> _Pattern:
    """own (n, 6) and pull (n, s, 6): gradients and pull in their own units."""
    n, s, _ = pull.shape
    z = (F.T @ own).ravel()
    pulled = (F.T @ pull.reshape(n, -1)).reshape(-1, s, 6).transpose(1, 0, 2).reshape(s, -1)
    M = np.kron(F.T @ F, np.eye(6)) - pulled.T @ errors.covariance @ pulled
    logs, bordered = [], np.zeros((len(z) + 1, len(z) + 1))
    bordered[-1, :-1], bordered[-1, -1] = z, 1 + 2 * z @ z
    for level in LEVELS:
        # With z as one row more, the factor's last row is root^-1 z.
        bordered[:-1, :-1] = np.eye(len(z)) + level * M
        root = np.linalg.cholesky(bordered)
        left = root[-1, :-1]
        logs.append(0.5 * level * float(left @ left) - float(np.sum(np.log(np.diag(root)[:-1]))))
    return _Pattern(of_order, np.array(logs), errors.covariance @ pulled)
