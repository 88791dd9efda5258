"""Has anything changed, and what: hypotheses side by side, each against what its noise could be.

    gained = chi2(nothing changed) - chi2(hypothesis)   ~ chi-square of the hypothesis's freedom, if nothing changed
    misfit = chi2(hypothesis) - chi2(every photo free)  ~ chi-square of what is left, if the hypothesis holds

Where a robot stands between, its noise is known as well as the views of the calibration tell it, and a single pose may
be off by more than a Gaussian allows: each view counts as one draw, and chi-square over its freedom becomes Fisher's F
with as many degrees of freedom below as there were views to spare.

Five questions are asked at most (did the camera move, was it shifted without a turn, did the target move, is any photo
elsewhere, is the lens another), so that each may answer by chance as much less often (Bonferroni). A shift has half the
freedom of a move, so that small ones stand out: seen from where it works a turn is one too. That the lens is another is
asked with every photo's pose free: no robot has a say in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.pose.both_solutions import LEAST_SIGMA_PX
from calibrant.calibrate.reprojection.weights import excess_sigma
from calibrant.optimize.chances import chi2_tail, f_tail
from calibrant.verification.unchanged.model import Fit, Model, solve
from calibrant.verification.unchanged.spread import Spread, places

CHANCE = 2e-3
"""Chance of calling changed what is not, for all questions together: a fifth of the one in a hundred promised, since
people's noise has heavier tails than a Gaussian's."""
QUESTIONS = 5
CAMERA, TARGET, BOTH, LENS_CHANGED = "camera", "target", "camera and target", "lens"
CAMERA_MOVED, TARGET_MOVED = "camera moved", "target moved"
"""Transforms that stand at the identity where nothing changed: T_before_after, in the axes of before."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Something that could have changed, and how well that explains the photos.

    chance: of a gain as large where nothing changed; fits: chance of a misfit as large where this is what changed.
    """

    what: str
    fit: Fit
    chance: float
    fits: float

    @property
    def explains(self) -> bool:
        """Whether nothing beyond this is needed."""
        return self.fits > CHANCE


@dataclass(frozen=True, eq=False)
class Decision:
    """The answer: chance of photos like these where nothing changed, and every hypothesis, the best first."""

    nothing: Fit
    free: Fit
    hypotheses: tuple[Hypothesis, ...]
    chance: float
    sigma_px: float
    """Noise of a point per axis as it was taken: the calibration's, or that of these photos where it is larger."""
    below: float = inf
    """Degrees of freedom that the noise of poses is known with."""
    lens_factor: float = 1.0
    """By what the variance of a lens is larger than white noise alone makes it."""

    @property
    def changed(self) -> bool:
        """Whether something changed."""
        return self.chance < CHANCE

    @property
    def explaining(self) -> tuple[Hypothesis, ...]:
        """The hypotheses that explain the photos, of which these photos cannot tell one from the other; combined ones
        only where no single one does."""
        found = [h for h in self.hypotheses if h.explains]
        single = [h for h in found if h.what != BOTH]
        return tuple(single or found)

    def named(self, what: str) -> Hypothesis | None:
        """The hypothesis of that name, where it was asked."""
        return next((h for h in self.hypotheses if h.what == what), None)


@dataclass(frozen=True, eq=False)
class Question:
    """A hypothesis to be asked: what changed, the transforms that are free then, where they begin, and the lens."""

    what: str
    free: tuple[str, ...] = ()
    at: Mapping[str, Array] | None = None
    lens: bool = False


def decide(
    nothing: Model, free: Model, questions: Sequence[Question], spread: Spread, *, below: float = inf
) -> Decision:
    """Fit every hypothesis and weigh it.

    nothing: the model where nothing changed; free: every photo at a pose of its own; spread: how much more than white
    noise the lens differs from view to view; below: degrees of freedom that the noise of poses is known with.
    """
    every = solve(free.freed(lens=True))
    sigmas, sigma_px = _noise(every, spread.sigma_px)
    nothing, free = _weighed(nothing, sigmas), _weighed(free, sigmas)
    base, poses, every = solve(nothing), solve(free), solve(free.freed(lens=True))
    now = [i for i, p in enumerate(free.photos) if p.now]
    shared = spread.shared_by(len(now), places(np.stack([every.pose(i) for i in now])))
    of_lens = float(f_tail(3, spread.freedom, max(poses.chi2 - every.chi2, 0.0) / (3 * shared)))
    chances = [of_lens]
    dims = free.freedom - nothing.freedom
    if dims:
        chances.append(_chance(dims, base.chi2 - poses.chi2, below))
    if CAMERA_MOVED in nothing.base:
        shifted = solve(replace(nothing, shifted=CAMERA_MOVED))
        chances.append(_chance(3, base.chi2 - shifted.chi2, below))
    hypotheses = []
    for q in questions:
        asked = nothing.freed(*q.free, lens=q.lens, at=q.at)
        fit = solve(asked)
        more = asked.freedom - nothing.freedom
        chance = of_lens if q.lens and not q.free else _chance(more, base.chi2 - fit.chi2, below)
        if not q.lens:
            chances.append(chance)
        rest = (every if q.lens else poses).chi2
        left = free.freedom + 3 * q.lens - asked.freedom
        fits = _chance(left, (fit.chi2 - rest) / (shared if q.lens else 1.0), below) if left > 0 else 1.0
        hypotheses.append(Hypothesis(q.what, fit, chance, fits))
    hypotheses.sort(key=lambda h: (not h.explains, h.what == BOTH, h.fit.chi2))
    return Decision(base, poses, tuple(hypotheses), min(1.0, len(chances) * min(chances)), sigma_px, below, shared)


def _chance(freedom: int, value: float, below: float) -> float:
    """Of a chi-square as large, its noise known with as many degrees of freedom as stand below."""
    if below == inf:
        return chi2_tail(freedom, max(value, 0.0))
    return float(f_tail(freedom, below, max(value, 0.0) / freedom))


def _noise(every: Fit, stated: float | None) -> tuple[list[Array], float]:
    """Sigma (n,) of each photo's points, and the noise of the typical one: the detector's word with what the residuals
    show beyond it where everything is free, and no less than at the calibration."""
    photos = every.model.photos
    squares = np.concatenate([np.sum(r * r, axis=1) for r in every.residuals])
    spare = float(max(2 * len(squares) - every.model.freedom, 1))
    if all(p.view.sigma_px is not None for p in photos):
        word = np.concatenate([p.view.sigma_px for p in photos if p.view.sigma_px is not None])
        sigma = np.hypot(word, excess_sigma(squares, word, freedom=spare))
    else:
        sigma = np.full(len(squares), max(float(np.sqrt(squares.sum() / spare)), LEAST_SIGMA_PX))
    seen = float(1 / np.sqrt(np.mean(sigma**-2)))
    sigma = sigma * max(1.0, (stated or 0.0) / seen)
    return np.split(sigma, np.cumsum([len(p.view) for p in photos])[:-1]), max(seen, stated or 0.0)


def _weighed(model: Model, sigmas: Sequence[Array]) -> Model:
    """The model with these sigmas of its photos' points."""
    return replace(model, photos=tuple(replace(p, sigma=s) for p, s in zip(model.photos, sigmas, strict=True)))
