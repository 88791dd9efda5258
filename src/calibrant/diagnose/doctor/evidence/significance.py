"""How likely evidence is by chance: one place for the tests that faults share."""

from __future__ import annotations

import numpy as np

from calibrant.optimize.chances import f_tail, t_tail

CONVINCING = 1e-3
"""Chance of a false alarm of one kind of fault on clean data, after counting its hypotheses. Ten kinds then raise one
in a hundred calibrations; what is proposed must besides improve the loop by an amount that matters."""


def ratio_test(before: float, after: float, freedom: int, *, hypotheses: int = 1) -> float:
    """p of squared residuals that fall from `before` to `after`, each with `freedom` numbers free (F test)."""
    if after <= 0:
        return 0.0 if before > 0 else 1.0
    return min(1.0, hypotheses * float(f_tail(max(freedom, 1), max(freedom, 1), max(before / after, 0.0))))


def nested_test(before: float, after: float, unknowns: int, freedom: int, *, hypotheses: int = 1) -> float:
    """p of squared residuals that fall from `before` to `after` by more unknowns; `freedom` is that of `after`."""
    if freedom <= 0:
        return 1.0
    if after <= 0:
        return 0.0 if before > 0 else 1.0
    F = max(before - after, 0.0) / unknowns / (after / freedom)
    return min(1.0, hypotheses * float(f_tail(unknowns, freedom, F)))


def student_test(value: float, sigma: float, freedom: int) -> float:
    """Two-sided p of a value that should be zero."""
    if freedom <= 0:
        return 1.0
    if sigma <= 0:
        return 1.0 if value == 0 else 0.0
    return float(2 * t_tail(freedom, np.abs(value) / sigma))


def confidence(p: float) -> float:
    """1 - p; never a certainty."""
    return float(min(1 - p, 1 - 1e-12))
