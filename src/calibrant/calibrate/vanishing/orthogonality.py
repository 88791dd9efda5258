"""Are the scene's directions orthogonal? Each is found from its own edges alone, and the angles are compared with 90.

With M_k = sum n_i n_i^T / sigma_i^2 over the edges of direction k, d_k is the eigenvector of the least eigenvalue and
its covariance pinv(M_k) across d_k. sigma_i is of the fit that holds them at right angles, where edges that are not err
by what they lack: it is scaled to what each leaves about its own direction, over all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.vanishing.circles import Circles
from calibrant.calibrate.vanishing.fit import Fit
from calibrant.calibrate.vanishing.search import scaled_normals, whitened
from calibrant.cameras import Camera

FEWEST_EDGES = 3
"""Two edges give a direction whatever they are; a third one has a say."""
OF_THE_FIT = 4.0
"""Edges that the noise of the whole fit counts as: a handful about their own directions may lie close by chance."""


@dataclass(frozen=True)
class RightAngle:
    """How far two directions a and b (0, 1, 2 for x, y, z) are from being at right angles, degrees, with its sigma."""

    a: int
    b: int
    off_deg: float
    sigma_deg: float

    def renamed(self, place: dict[int, int]) -> RightAngle:
        """The same with other names for the directions."""
        a, b = sorted((place[self.a], place[self.b]))
        return replace(self, a=a, b=b)


def right_angles(
    fit: Fit, circles: Circles, refit: Callable[[Array], Circles] | None, camera: Camera
) -> tuple[RightAngle, ...]:
    """The angles between directions with edges enough.

    Args: refit, circles of other camera parameters, where the camera's uncertainty counts. With an unknown focal length
    two directions are orthogonal by its choice: their angle is then left out.
    """
    known = [k for k in range(3) if np.sum(fit.member == k) >= FEWEST_EDGES]
    pairs = [(a, b) for a in known for b in known if a < b]
    if fit.solution.problem.variables[1].free_dim and len(known) < 3:
        return ()
    variance_of_camera = np.zeros(len(pairs))
    if refit is not None and camera.covariance is not None:
        steps = np.sqrt(np.diag(camera.covariance))
        slope = np.zeros((len(pairs), len(steps)))
        for j in np.flatnonzero(steps > 0):
            e = steps[j] * np.eye(len(steps))[j]
            high, low = (_circle_angles(fit, refit(camera.values + k * e), pairs)[0] for k in (1, -1))
            slope[:, j] = (high - low) / (2 * steps[j])
        variance_of_camera = np.einsum("pi,ij,pj->p", slope, camera.covariance, slope)
    off, variance = _circle_angles(fit, circles, pairs)
    sigma = np.sqrt(variance + variance_of_camera)
    return tuple(
        RightAngle(a, b, float(np.rad2deg(o)), float(np.rad2deg(s))) for (a, b), o, s in zip(pairs, off, sigma)
    )


def _circle_angles(fit: Fit, circles: Circles, pairs: list[tuple[int, int]]) -> tuple[Array, Array]:
    """Angle less 90 degrees of each pair, and its variance: two (p,), radians."""
    found = {k: _circle_direction(fit, circles, k) for k in {k for pair in pairs for k in pair}}
    squares = sum(least for _, _, least in found.values())
    spare = sum(int(np.sum(fit.member == k)) - 2 for k in found)
    own = min((squares + OF_THE_FIT) / (spare + OF_THE_FIT), 1.0)
    off, variance = np.zeros(len(pairs)), np.zeros(len(pairs))
    for i, (a, b) in enumerate(pairs):
        (da, Ca, _), (db, Cb, _) = found[a], found[b]
        off[i] = -np.arcsin(np.clip(da @ db, -1, 1))
        variance[i] = own * (db @ Ca @ db + da @ Cb @ da)
    return off, variance


def _circle_direction(fit: Fit, circles: Circles, k: int) -> tuple[Array, Array, float]:
    """A direction (3,) from its own edges, its sign that of the fit, its covariance (3, 3), and the squares left."""
    mine = fit.member == k
    d = fit.R_camera_scene[:, k]
    _, unit = whitened(circles.only(mine), d, fit.focal)
    n = scaled_normals(circles.only(mine), fit.focal) / (unit * fit.noise[mine])[:, None]
    spread, axes = np.linalg.eigh(n.T @ n)
    own = axes[:, 0] * np.where(axes[:, 0] @ d < 0, -1.0, 1.0)
    covariance = (axes[:, 1:] / np.maximum(spread[1:], 1e-300)) @ axes[:, 1:].T
    return own, covariance, float(max(spread[0], 0.0))
