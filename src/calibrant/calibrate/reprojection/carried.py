"""Points that a camera's corners carry into another picture: a projector's pixels, read off at corners in a camera.

A projector sees nothing. The pixel q that lights a corner is read off the decoded picture at the place u where the
camera found it, so that the camera's error e is in both: u + e and q + S e, S = dq/du. Taken for two measurements, the
one error is counted twice. The residual

    r = (project_b(X) - q) - S (project_a(X) - u)

is what the decoded picture says at the place where camera a should see the corner, less what b should light there: it
holds the decoding's error alone, and is independent of a's own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.reprojection.factor import ReprojectionFactor
from calibrant.optimize.factors import Factor


class CarriedFactor(Factor):
    """Residuals of views whose points were carried from another camera's; an edge is a view, a block a point.

    seen: the reprojection of the views themselves; at: that of the same points in the other camera, edge by edge;
    slope (N, 2, 2). A transform that both pass is one slot.
    """

    def __init__(self, name: str, *, seen: ReprojectionFactor, at: ReprojectionFactor, slope: Array) -> None:
        self.seen, self.at, self.slope = seen, at, np.asarray(slope, dtype=np.float64)
        variables, indices = list(seen.variables), list(seen.indices)
        self._slots: list[int] = []
        for variable, index in zip(at.variables, at.indices):
            same = [k for k, v in enumerate(variables) if v == variable and np.array_equal(indices[k], index)]
            if not same:
                variables.append(variable)
                indices.append(index)
            self._slots.append(same[0] if same else len(variables) - 1)
        super().__init__(
            name,
            variables=variables,
            indices=indices,
            dim=2,
            noise=seen.noise,
            relative_sigma=seen.views.sigma,
            whitening=seen.views.whitening,
            row_offsets=seen.views.offsets,
            loss=seen.loss,
        )

    def _parts(self, values: Sequence[Array]) -> tuple[Sequence[Array], list[Array]]:
        return values[: len(self.seen.variables)], [values[k] for k in self._slots]

    def residuals(self, *values: Array) -> Array:
        seen, at = self._parts(values)
        carried = np.einsum("nij,nj->ni", self.slope, self.at.residuals(*at))
        return np.asarray(self.seen.residuals(*seen) - carried)

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        seen, at = self._parts(values)
        r, J = self.seen.linearize(*seen)
        r_at, J_at = self.at.linearize(*at)
        jacobians: list[Array | None] = [*J, *([None] * (len(self.variables) - len(J)))]
        for k, own in zip(self._slots, J_at):
            share, there = -self.slope @ own, jacobians[k]
            jacobians[k] = share if there is None else there + share
        return r - np.einsum("nij,nj->ni", self.slope, r_at), tuple(j for j in jacobians if j is not None)
