"""Chi-square tests: do the residuals have the size that the noise levels say?

A group's weighted sum of squares v^T v / sigma^2 is chi-square distributed with its redundancy r as degrees of freedom
(exactly for one group, to first order for several). At levels that were *estimated* it equals r by construction; the
question makes sense for levels that were stated: a data sheet's, a detector's, an earlier calibration's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from calibrant.optimize.chances import chi2_tail
from calibrant.optimize.noise import NoiseEstimate, redundancies
from calibrant.optimize.solution import Solution


@dataclass(frozen=True)
class ChiSquare:
    """A weighted sum of squares and the degrees of freedom it should have."""

    statistic: float
    freedom: float

    @property
    def ratio(self) -> float:
        """Statistic over freedom: the variance is this many times the stated one."""
        return self.statistic / self.freedom

    @property
    def above(self) -> float:
        """Probability of a larger statistic, were the stated level true: near 0 when the noise is larger."""
        return chi2_tail(self.freedom, self.statistic)

    def agrees(self, *, significance: float = 0.01) -> bool:
        """True when neither tail is less likely than significance / 2."""
        return significance / 2 <= self.above <= 1 - significance / 2


def chi_squares(solution: Solution) -> dict[str, ChiSquare]:
    """The test of every noise group at the levels of the solution; groups without redundancy are left out."""
    return {
        group: ChiSquare(squares / solution.sigmas.get(group, 1.0) ** 2, freedom)
        for group, (squares, freedom, _) in redundancies(solution).items()
        if freedom > 0.5
    }


def against_stated(estimate: NoiseEstimate, stated: Mapping[str, float]) -> dict[str, ChiSquare]:
    """Estimated levels against stated ones: sigma^2 r / sigma_stated^2, for the groups named in both."""
    return {
        group: ChiSquare(level.sigma**2 * level.redundancy / stated[group] ** 2, level.redundancy)
        for group, level in estimate.levels.items()
        if group in stated and level.determined
    }
