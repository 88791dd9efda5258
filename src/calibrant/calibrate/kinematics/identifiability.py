"""Which parameters of a model can be told apart: by the structure of the robot, and by the poses that were taken.

The columns of the regressor (the derivative of all measurements by every parameter) are taken in order of preference. A
column joins those kept when a part of its effect cannot be had from them (Gram-Schmidt, that is QR without pivoting:
Khalil and Dombre, sec. 11.3; Meggiolaro and Dubowsky 2000). What a removed one is worth in kept ones is said.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.calibrate.kinematics.model import GROUPS, RobotModel

INDEPENDENT = 1e-3
"""Share of a column's effect that must be its own: an error of a kept parameter's effect below a thousandth would be
lost in the model's own second order. Axes 0.05 degrees from parallel count as parallel."""

SAMPLES = 100
"""Random joint values for the structure: 300 rows and more for fewer than a hundred columns."""

_NAMED_SHARE = 0.3
_NAMED_MOST = 3


@dataclass(frozen=True, eq=False)
class Selection:
    """keep (p,): parameters that can be identified. reasons: why others were removed, by their index."""

    keep: Mask
    reasons: dict[int, str]


def select(model: RobotModel, joints: Array, candidates: Mask, *, rotations_measured: bool, seed: int = 0) -> Selection:
    """Parameters among `candidates` (p,) that this robot has and these joint values (n, k) show.

    First by random joint values within the limits: what is redundant there is redundant anywhere. Then by the values
    measured: what is lost there is a lack of motion, which more poses cure.
    """
    order = _preference(model)
    everywhere = _regressor(model, _random_joints(model, seed), rotations_measured)
    structure = _independent(everywhere, [k for k in order if candidates[k]])
    here = _regressor(model, joints, rotations_measured)
    shown = _independent(here, structure)
    removed = [k for k in np.flatnonzero(candidates).tolist() if k not in structure]
    reasons = {k: f"redundant: {same}" for k, same in zip(removed, _equivalents(model, everywhere, removed, structure))}
    hidden = [k for k in structure if k not in shown]
    for k, same in zip(hidden, _equivalents(model, here, hidden, shown)):
        reasons[k] = f"these poses do not show it: {same}; add poses that move the joints differently"
    keep = np.zeros(len(model.parameters), dtype=bool)
    keep[shown] = True
    return Selection(keep, reasons)


def _preference(model: RobotModel) -> list[int]:
    groups = [GROUPS.index(p.group) for p in model.parameters]
    return sorted(range(len(groups)), key=lambda k: groups[k])


def _random_joints(model: RobotModel, seed: int) -> Array:
    lower, upper = (np.clip(v, -np.pi, np.pi) for v in (model.chain.lower, model.chain.upper))
    # A joint whose whole range lies beyond half a turn is clipped to a point: then its own range serves.
    empty = ~(lower < upper)
    lower, upper = np.where(empty, model.chain.lower, lower), np.where(empty, model.chain.upper, upper)
    return np.random.default_rng(seed).uniform(lower, upper, (SAMPLES, len(lower)))


def _regressor(model: RobotModel, joints: Array, rotations_measured: bool) -> Array:
    """Rows: what is measured, metres and radians alike; a radian on a lever of a metre moves a metre."""
    J = model.linearize(joints)[1]
    J = J if rotations_measured else J[:, 3:]
    return J.reshape(-1, J.shape[-1])


def _independent(J: Array, order: Sequence[int]) -> list[int]:
    """Columns, in order, that are not combinations of those before them."""
    basis = np.zeros((len(J), 0))
    kept: list[int] = []
    for k in order:
        column = J[:, k]
        size = np.linalg.norm(column)
        if size < 1e-12:
            continue
        rest = column - basis @ (basis.T @ column)
        rest = rest - basis @ (basis.T @ rest)  # a second pass removes what rounding left of the first
        own = np.linalg.norm(rest)
        if own > INDEPENDENT * size and len(kept) < len(J):
            basis = np.column_stack([basis, rest / own])
            kept.append(k)
    return kept


def _equivalents(model: RobotModel, J: Array, removed: Sequence[int], kept: Sequence[int]) -> list[str]:
    """What each removed column is in kept ones, in words."""
    size = np.linalg.norm(J, axis=0)
    unit = J / np.where(size > 0, size, 1.0)
    A = unit[:, list(kept)]
    # The kept columns are independent to 1e-3, so that their Gram matrix is safe to invert (1e-6).
    share: Array = np.linalg.solve(A.T @ A, A.T @ unit[:, list(removed)]).astype(np.float64)
    names = [model.parameters[k].name for k in kept]
    return [_in_words(names, share[:, i], float(size[k])) for i, k in enumerate(removed)]


def _in_words(names: Sequence[str], share: Array, size: float) -> str:
    if size < 1e-12 or not names:
        return "it has no effect on what is measured"
    strongest = np.argsort(-np.abs(share))[:_NAMED_MOST]
    named = [names[i] for i in strongest if abs(share[i]) > _NAMED_SHARE]
    return f"it acts as {' with '.join(named)}" if named else "it acts as several others together"
