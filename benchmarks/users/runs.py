"""One run and what came of it, and the figures of many runs of a condition."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

import calibrant as cb
from users.rigid import Array

REGION = {4: 18.467, 6: 22.458}
"""99.9 % of chi-square with 4 and 6 degrees of freedom."""
NINETY_FIVE = 1.95996
ADVICE = frozenset(
    {
        "corner-coverage", "image-coverage", "tilt-range", "distance-range", "views", "focal-length",
        "poses", "small-rotations", "parallel-axes", "held-out",
    }
)  # fmt: skip
"""Checks that ask for other photos or poses and say nothing against these: a wrong result that they alone warn of is
hidden, a right one that they warn of was asked for something to do."""


@dataclass(frozen=True, eq=False)
class Run:
    """verdict: ok, warn, refused, or error (an exception that is no refusal). error: e^T C^-1 e, of the truth that is
    nearest; scores (n,) the errors over their sigmas; growth: stated sigma over the least that white noise allows."""

    seed: int
    verdict: str
    warned: tuple[str, ...] = ()
    words: tuple[str, ...] = ()
    error: float = np.nan
    dof: int = 4
    scores: Array = field(default_factory=lambda: np.full(4, np.nan))
    growth: float = np.nan
    ms: float = 0.0

    @property
    def outside(self) -> bool:
        """The truth lies outside the stated 99.9 % region."""
        return bool(self.error > REGION[self.dof])

    @property
    def silent(self) -> bool:
        return self.verdict == "ok" and self.outside

    @property
    def hidden(self) -> bool:
        """Outside, and warned of by nothing but advice about the photos: silent by luck of the draw."""
        return self.verdict == "warn" and self.outside and set(self.warned) <= ADVICE


def judged(
    seed: int,
    estimate: Callable[[], tuple[cb.CalibrationResult, Array, Array]],
    errors: Callable[[Array], Sequence[Array]],
    least: Array,
) -> Run:
    """Run `estimate` (result, values, covariance); errors(values) are those against each truth a person may mean."""
    began = time.perf_counter()
    try:
        result, values, C = estimate()
    except cb.RefusedError as refusal:
        ms = 1e3 * (time.perf_counter() - began)
        held = getattr(refusal, "result", None)
        failed = () if held is None else tuple(c.name for c in held.checks if c.status == "fail")
        return Run(seed, "refused", failed or ("refused",), (str(refusal),), dof=len(least), ms=ms)
    except cb.InputError as refusal:
        ms = 1e3 * (time.perf_counter() - began)
        return Run(seed, "refused", ("input",), (str(refusal),), dof=len(least), ms=ms)
    except Exception as fault:  # noqa: BLE001 - what a benchmark counts
        return Run(seed, "error", (type(fault).__name__,), (repr(fault),), dof=len(least))
    ms = 1e3 * (time.perf_counter() - began)
    best = min(errors(values), key=lambda e: normalised(e, C))
    sigma = np.sqrt(np.diag(C))
    warned = [c for c in result.checks if c.status != "ok"]
    return Run(
        seed,
        result.verdict,
        tuple(c.name for c in warned),
        tuple(f"{c.name}: {c.message}" for c in warned),
        normalised(best, C),
        len(best),
        best / sigma,
        float(np.exp(np.mean(np.log(sigma / np.sqrt(np.diag(least)))))),
        ms,
    )


def normalised(error: Array, C: Array) -> float:
    """e^T C^-1 e."""
    scale = 1 / np.sqrt(np.diag(C))
    return float((error * scale) @ np.linalg.solve(C * scale * scale[:, None], error * scale))


@dataclass(frozen=True)
class Figures:
    """What the runs of one condition come to. mean: e^T C^-1 e a degree of freedom; NaN where there is none."""

    name: str
    runs: int
    verdicts: dict[str, int]
    silent: int
    silent_seeds: list[int]
    hidden: int
    mean: float
    median: float
    mean_ok: float
    median_ok: float
    covered: float
    covered_ok: float
    growth: float
    growth_ok: float
    warned: dict[str, int]
    for_nothing: int
    """Results that are warned of by more than advice."""
    ms: float


def figures(name: str, runs: Sequence[Run]) -> Figures:
    answered = [r for r in runs if np.isfinite(r.error)]
    ok = [r for r in answered if r.verdict == "ok"]
    verdicts = Counter(r.verdict for r in runs)

    def each(of: list[Run], what: Callable[[Run], float], how: Callable[[list[float]], float]) -> float:
        return float(how([what(r) for r in of])) if of else float("nan")

    def a_dof(r: Run) -> float:
        return r.error / r.dof

    def covered(r: Run) -> float:
        return float(np.mean(np.abs(r.scores) <= NINETY_FIVE))

    return Figures(
        name,
        len(runs),
        {v: verdicts[v] for v in ("ok", "warn", "refused", "error")},
        sum(r.silent for r in runs),
        [r.seed for r in runs if r.silent],
        sum(r.hidden for r in runs),
        each(answered, a_dof, np.mean),
        each(answered, a_dof, np.median),
        each(ok, a_dof, np.mean),
        each(ok, a_dof, np.median),
        each(answered, covered, np.mean),
        each(ok, covered, np.mean),
        each(answered, lambda r: r.growth, np.median),
        each(ok, lambda r: r.growth, np.median),
        dict(Counter(name for r in runs for name in set(r.warned)).most_common()),
        sum(r.verdict == "warn" and not set(r.warned) <= ADVICE for r in runs),
        each(list(runs), lambda r: r.ms, np.median),
    )
