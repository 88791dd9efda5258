"""Least squares on the loop alone: X and Z that make A_i X B_i = Z_i agree, with the noise that their spread shows.

    min sum_i |omega_i|^2 / (c_i sigma_omega)^2 + |v_i|^2 / (c_i sigma_v)^2,   (omega_i, v_i) = local(Z, A_i X B_i(s))

where B(s) has its translation times the target's scale s, and c_i says how much less certain a view is than others.
The two noise levels are the spread of the residuals themselves over the numbers that are left free. Views may belong
to groups with a camera transform or a target transform of their own: a camera or a target that moved in between.

One fit of 50 views costs about a millisecond; it is what hypotheses are compared by, not the calibration that is
handed out (`joint` weighs pixels and robot).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.geometry import se3, so3

Groups = NDArray[np.intp]

MAX_STEPS = 12
"""Gauss-Newton settles in three or four steps from a closed form; re-weighting takes a few more."""
SETTLED = 1e-7
"""Steps below this, in sigmas of the residuals, change nothing that a test could see."""
LEVEL_RATIO = 0.1
"""Neither noise level is taken for less than a tenth of what the other one makes of it at the target's distance: three
or four views can close their positions exactly by turning a little, which is no sign of positions without noise."""
FLOOR_ROTATION, FLOOR_TRANSLATION = 1e-7, 1e-7
"""Radians and metres below which a spread is rounding."""


@dataclass(frozen=True, eq=False)
class Model:
    """What a fit may vary beside one X and one Z.

    camera_of, target_of (n,): index of the X and of the Z that each view uses; free_scale: the target's scale too.
    """

    camera_of: Groups
    target_of: Groups
    free_scale: bool = False

    @cached_property
    def cameras(self) -> int:
        return int(self.camera_of.max()) + 1

    @cached_property
    def targets(self) -> int:
        return int(self.target_of.max()) + 1

    @property
    def unknowns(self) -> int:
        return 6 * (self.cameras + self.targets) + int(self.free_scale)


def plain_model(n: int, *, free_scale: bool = False) -> Model:
    """One X and one Z for all n views."""
    return Model(np.zeros(n, dtype=np.intp), np.zeros(n, dtype=np.intp), free_scale)


@dataclass(frozen=True, eq=False)
class LoopFit:
    """X (k, 4, 4), Z (m, 4, 4) and the target's scale that fit the views in `used`.

    deviation (n, 6): local(Z, A_i X B_i) of every view, radians and metres; sigma_rotation, sigma_translation: noise of
    a typical view per axis, rad and m; covariance of (X, Z, scale) in the order of the tangents; rows (n, 6, p): how
    each deviation answers them; certainty (n,) >= 1.
    """

    X: Array
    Z: Array
    scale: float
    deviation: Array
    sigma_rotation: float
    sigma_translation: float
    covariance: Array
    rows: Array
    used: NDArray[np.bool_]
    certainty: Array
    model: Model = field(repr=False)

    @property
    def freedom(self) -> int:
        """Numbers left free: 6 a view used, less the unknowns."""
        return 6 * int(self.used.sum()) - self.model.unknowns

    @property
    def sigma_scale(self) -> float:
        """1 sigma of the scale; 0 when it was held."""
        return float(np.sqrt(self.covariance[-1, -1])) if self.model.free_scale else 0.0

    @property
    def sigmas(self) -> Array:
        """(n, 6) noise of each view's deviation."""
        level = np.repeat([self.sigma_rotation, self.sigma_translation], 3)
        return self.certainty[:, None] * level

    @property
    def statistic(self) -> Array:
        """(n,) d_i^T S_i^-1 d_i / 6 with S_i = noise + what X, Z and scale are uncertain by: F(6, freedom) for views
        that were not used; for used ones the noise less that, so that a view does not excuse itself."""
        spread = self.rows @ self.covariance @ np.swapaxes(self.rows, 1, 2)
        sign = np.where(self.used, -1.0, 1.0)[:, None, None]
        noise = self.sigmas**2
        S = noise[:, None, :] * np.eye(6) + sign * spread
        # A view that alone holds an unknown has nothing left to be judged by: never below a tenth of its noise.
        S = np.where(self.used[:, None, None], S + 0.1 * noise[:, None, :] * np.eye(6), S)
        d = self.deviation
        return np.einsum("ni,ni->n", d, np.linalg.solve(S, d[..., None])[..., 0]) / 6

    def rms(self, views: NDArray[np.bool_] | None = None) -> tuple[float, float]:
        """Spread of the loop over the views used (or those given): mm and deg rms."""
        d = self.deviation[self.used if views is None else views]
        mm = 1e3 * np.sqrt(np.mean(np.sum(d[:, 3:] ** 2, axis=1)))
        return float(mm), float(np.rad2deg(np.sqrt(np.mean(np.sum(d[:, :3] ** 2, axis=1)))))

    def squares(self, sigma_rotation: float, sigma_translation: float) -> float:
        """Sum of the squared residuals of the views used, weighted by given noise levels."""
        d = self.deviation[self.used] / self.certainty[self.used, None]
        return float(np.sum(d[:, :3] ** 2) / sigma_rotation**2 + np.sum(d[:, 3:] ** 2) / sigma_translation**2)


def fit_loop(
    A: Array,
    B: Array,
    X: Array,
    *,
    model: Model | None = None,
    used: NDArray[np.bool_] | None = None,
    certainty: Array | None = None,
    scale: float = 1.0,
    steps: int = MAX_STEPS,
) -> LoopFit:
    """Fit the loop from a start X (4, 4) or (k, 4, 4); Z starts at the mean of the loops.

    Args: A, B (n, 4, 4) of the normal form, metres; used (n,) the views that count; certainty (n,) >= 1;
    steps, at most.
    """
    n = len(A)
    model = model or plain_model(n)
    used = np.ones(n, dtype=bool) if used is None else used
    c = np.ones(n) if certainty is None else np.maximum(certainty, 1.0)
    Xs = np.array(np.broadcast_to(X, (model.cameras, 4, 4)))
    Zs = _start_targets(A, B, Xs, model, used, scale)
    deviation, rows = linearised(A, B, Xs, Zs, scale, model)
    reach = float(np.median(np.linalg.norm(B[used, :3, 3], axis=1)))
    levels = _levels(deviation, c, used, model, abs(scale) * reach)
    for _ in range(steps):
        step, normal = _step(deviation, rows, c, used, levels)
        Xs, Zs, scale = moved(Xs, Zs, scale, step, model)
        deviation, rows = linearised(A, B, Xs, Zs, scale, model)
        before, levels = levels, _levels(deviation, c, used, model, abs(scale) * reach)
        size = float(np.sqrt(max(float(step @ normal @ step), 0.0)))
        settled = all(abs(new - old) <= 1e-3 * old for new, old in zip(levels, before))
        if size < SETTLED * np.sqrt(6.0 * n) and settled:
            break
    _, normal = _step(deviation, rows, c, used, levels)
    covariance = np.asarray(np.linalg.pinv(normal, rcond=1e-14, hermitian=True), dtype=np.float64)
    return LoopFit(Xs, Zs, scale, deviation, levels[0], levels[1], covariance, rows, used, c, model)


def scaled(B: Array, scale: float) -> Array:
    """Target poses (n, 4, 4) with their translation times the scale."""
    out = B.copy()
    out[:, :3, 3] *= scale
    return out


def _start_targets(A: Array, B: Array, Xs: Array, model: Model, used: NDArray[np.bool_], scale: float) -> Array:
    loops = A @ (Xs[0] if model.cameras == 1 else Xs[model.camera_of]) @ scaled(B, scale)
    targets = []
    for k in range(model.targets):
        mine = used & (model.target_of == k)
        group = loops[mine if mine.any() else used]
        targets.append(se3.make(so3.nearest(group[:, :3, :3].sum(axis=0)), group[:, :3, 3].mean(axis=0)))
    return np.stack(targets)


def linearised(A: Array, B: Array, Xs: Array, Zs: Array, scale: float, model: Model) -> tuple[Array, Array]:
    """Deviations (n, 6) and their rows (n, 6, p) with respect to (X..., Z..., scale), tangents of se3.retract.

    omega <- omega + R_A dX_omega - dZ_omega,  v <- v + R_A (dX_v + dX_omega x R_X t_B) - dZ_v + R_A R_X t_B ds
    """
    n = len(A)
    # One transform for all is broadcast: a copy of it for every view costs as much as the rest.
    X = Xs[0] if model.cameras == 1 else Xs[model.camera_of]
    Z = Zs[0] if model.targets == 1 else Zs[model.target_of]
    deviation = se3.local(Z, A @ X @ scaled(B, scale))
    R_A = A[:, :3, :3]
    arm = np.asarray((X[..., :3, :3] @ B[:, :3, 3, None])[..., 0])
    of_arm = -R_A @ so3.hat(scale * arm)
    rows = np.zeros((n, 6, model.unknowns))
    for k in range(model.cameras):
        mine = slice(None) if model.cameras == 1 else model.camera_of == k
        rows[mine, :3, 6 * k : 6 * k + 3] = rows[mine, 3:, 6 * k + 3 : 6 * k + 6] = R_A[mine]
        rows[mine, 3:, 6 * k : 6 * k + 3] = of_arm[mine]
    first = 6 * model.cameras
    for k in range(model.targets):
        mine = slice(None) if model.targets == 1 else model.target_of == k
        rows[mine, :, first + 6 * k : first + 6 * k + 6] = -np.eye(6)
    if model.free_scale:
        rows[:, 3:, -1] = (R_A @ arm[..., None])[..., 0]
    return deviation, rows


def _levels(d: Array, c: Array, used: NDArray[np.bool_], model: Model, reach: float) -> tuple[float, float]:
    """Noise per axis of rotations and translations, each with its own unknowns taken off; reach: metres."""
    alike = d[used] / c[used, None]
    groups = 3 * (model.cameras + model.targets)
    m = 3 * int(used.sum())
    rotation = np.sqrt(np.sum(alike[:, :3] ** 2) / max(m - groups, 1))
    translation = np.sqrt(np.sum(alike[:, 3:] ** 2) / max(m - groups - int(model.free_scale), 1))
    least_rotation = LEVEL_RATIO * float(translation) / max(reach, 1e-9)
    least_translation = LEVEL_RATIO * reach * float(rotation)
    return (
        max(float(rotation), least_rotation, FLOOR_ROTATION),
        max(float(translation), least_translation, FLOOR_TRANSLATION),
    )


def _step(d: Array, rows: Array, c: Array, used: NDArray[np.bool_], levels: tuple[float, float]) -> tuple[Array, Array]:
    """Gauss-Newton step and the normal matrix (information)."""
    weight = 1 / (c[used, None] * np.repeat(levels, 3))
    J = (rows[used] * weight[..., None]).reshape(-1, rows.shape[2])
    r = (d[used] * weight).reshape(-1)
    normal = J.T @ J
    # Fewer views than a group has unknowns leave directions open: the shortest step leaves them alone.
    try:
        step = -np.linalg.solve(normal, J.T @ r)
    except np.linalg.LinAlgError:
        step = -np.linalg.lstsq(J, r, rcond=None)[0]
    return step, normal


def moved(Xs: Array, Zs: Array, scale: float, step: Array, model: Model) -> tuple[Array, Array, float]:
    """The unknowns after a step (p,) in the order of the rows of `linearised`."""
    k, m = model.cameras, model.targets
    of_X, of_Z = step[: 6 * k].reshape(k, 6), step[6 * k : 6 * (k + m)].reshape(m, 6)
    return se3.retract(Xs, of_X), se3.retract(Zs, of_Z), scale + (float(step[-1]) if model.free_scale else 0.0)
