"""The sequential test: picture after picture, has the camera been moved since one of them?

What a picture is off by, y (m,), is explained by errors of the calibration b that all pictures share, by an error r of
the robot's pose that pictures from one place share, by its own noise, and, from picture k on, by a move d:

    y_i = A_i b + B_i r_place + H_i d [i >= k] + e_i,    b, r ~ N(0, 1),    e_i ~ N(0, s^2 C_i)

For every k of the last pictures, and for the first of all, an information filter holds (b, r, d), d without a prior; a
place that is left is summed out. With D the covariance of d in it,

    gain_k = d^T (D + S)^-1 d,

is the generalised likelihood ratio of a jump at k (Willsky and Jones 1976), chi-square of dim d where nothing moved. S
is what an arm errs alike over all pictures since k, which looks like a moved camera. The noise's s^2 is told by
the pictures before k, never below the one that the calibration states, so that chi-square over its freedom is Fisher's
F. Each picture asks all its k (Bonferroni) with the chance 1 / run: between two false alarms lie `run` pictures or more
in the mean (the average run length), and 1000 pictures raise one with a chance of 1000 / run at most.

A picture that nothing explains is held back until the next one comes: if that is as it should be, it was a poor
picture, and is left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from math import inf

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.optimize.chances import chi2_tail, f_tail

RUN = 100_000.0
"""Pictures between two false alarms: one in 1000 pictures with a chance of 1 %."""
WINDOW = 20
"""Pictures back to which a move is looked for: twice as many as one must be named within."""
ODD = 1e-6
"""Chance of a picture that is held back until the next one comes."""
FITS = 1e-3
"""Chance above which the next one is as it should be."""


@dataclass(frozen=True, eq=False)
class Sight:
    """What one picture is off by, (m,), and what that may come from.

    of_calibration (m, p), of_place (m, r): what errors of unit variance do, of the calibration and of the robot's pose;
    place: number of the pose, the same for pictures taken one after another without moving; of_move (m, q): what a
    moved camera does, of_other (m, q): what a moved target does; covariance (m, m) of the picture's own noise; alike
    (q, q): covariance of a move that an arm that errs alike in all pictures looks like.
    """

    name: str
    off: Array
    of_calibration: Array
    of_place: Array
    place: int
    of_move: Array
    covariance: Array
    alike: Array | None = None
    of_other: Array | None = None


@dataclass(frozen=True)
class Rule:
    """run: pictures between two false alarms, in the mean; freedom: degrees of freedom that the stated noise is known
    with; window: pictures back to which a move is looked for."""

    run: float = RUN
    freedom: float = inf
    window: int = WINDOW

    def __post_init__(self) -> None:
        if not self.run >= 2:
            raise InputError(f"the pictures between two false alarms are 2 or more, such as 100000; got {self.run:g}")


@dataclass(frozen=True, eq=False)
class Filters:
    """Information filters side by side: matrix (w, D, D) and vector (w, D) of (b, r, d), squares (w,) of what was
    seen, and how many values that were."""

    matrix: Array
    vector: Array
    squares: Array
    values: int

    @classmethod
    def blank(cls, calibration: int, place: int) -> Filters:
        """One filter that has seen nothing."""
        return cls(np.eye(calibration + place)[None], np.zeros((1, calibration + place)), np.zeros(1), 0)

    def seen(self, y: Array, A: Array) -> Filters:
        """After a picture: y (m,), and A (m, D), both over its noise."""
        return Filters(self.matrix + A.T @ A, self.vector + y @ A, self.squares + float(y @ y), self.values + len(y))

    def moved_on(self, at: slice) -> Filters:
        """At another place: the error of the old one is summed out, the new one's is unit again."""
        width = at.stop - at.start
        if not width:
            return self
        M, v = self.matrix.copy(), self.vector.copy()
        inner = np.linalg.inv(M[:, at, at])
        left = M[:, :, at] @ inner
        M = M - left @ M[:, at, :]
        v = v - np.einsum("wij,wj->wi", left, self.vector[:, at])
        squares = self.squares - np.einsum("wi,wij,wj->w", self.vector[:, at], inner, self.vector[:, at])
        M[:, at, :] = M[:, :, at] = 0.0
        M[:, at, at] = np.eye(width)
        v[:, at] = 0.0
        return Filters(M, v, squares, self.values)

    def chi2(self) -> Array:
        """Squares (w,) that are left, over the noise."""
        return self.squares - np.einsum(
            "wi,wi->w", self.vector, np.linalg.solve(self.matrix, self.vector[..., None])[..., 0]
        )

    def with_move(self, q: int) -> Filters:
        """The same, with a move (q,) that nothing is known of."""
        size = self.matrix.shape[1]
        M, v = np.zeros((1, size + q, size + q)), np.zeros((1, size + q))
        M[:, :size, :size], v[:, :size] = self.matrix, self.vector
        return Filters(M, v, self.squares, self.values)

    def moves(self, q: int) -> tuple[Array, Array]:
        """The moves (w, q) and their covariances (w, q, q) over s^2."""
        M, v = self.matrix, self.vector
        back = np.linalg.solve(M[:, :-q, :-q], np.concatenate([M[:, :-q, -q:], v[:, :-q, None]], axis=-1))
        F = M[:, -q:, -q:] - M[:, -q:, :-q] @ back[..., :q]
        g = v[:, -q:] - (M[:, -q:, :-q] @ back[..., q:])[..., 0]
        scale = 1 / np.sqrt(np.maximum(np.einsum("wii->wi", F), 1e-300))
        C = np.linalg.pinv(F * scale[:, :, None] * scale[:, None, :], hermitian=True)
        C = C * scale[:, :, None] * scale[:, None, :]
        return np.einsum("wij,wj->wi", C, g), C

    def kept(self, rows: Array) -> Filters:
        """Only these filters."""
        return Filters(self.matrix[rows], self.vector[rows], self.squares[rows], self.values)

    def beside(self, other: Filters) -> Filters:
        """These and others that have seen as much."""
        parts = [np.concatenate(pair) for pair in zip(self._arrays, other._arrays)]
        return Filters(parts[0], parts[1], parts[2], self.values)

    @property
    def _arrays(self) -> tuple[Array, Array, Array]:
        return self.matrix, self.vector, self.squares


@dataclass(frozen=True, eq=False)
class Start:
    """A picture that a move may have come before: its index and name, the noise s^2 that those before it tell, and the
    degrees of freedom of that."""

    index: int
    name: str
    noise: float
    freedom: float


@dataclass(frozen=True, eq=False)
class Alarm:
    """The camera has been moved: since: index of the first picture after it; at: of the picture that told; chance: of
    as much where nothing moved, all its questions together; since_name, at_name: of these pictures."""

    since: int
    at: int
    chance: float
    since_name: str
    at_name: str


@dataclass(frozen=True, eq=False)
class Watch:
    """The state after some pictures; `after` gives the next one.

    chance: of the last picture's questions; move (q,) since the likeliest one, with covariance (q, q); poor: names of
    pictures that were left out; alarm: None until it is raised, and for good from then on.

        state = Watch(Rule())
        for sight in sights:
            state = state.after(sight)
    """

    rule: Rule
    count: int = 0
    chance: float = 1.0
    move: Array | None = None
    covariance: Array | None = None
    since: int | None = None
    alarm: Alarm | None = None
    poor: tuple[str, ...] = ()
    steady: Filters | None = field(default=None, repr=False)
    bank: Filters | None = field(default=None, repr=False)
    starts: tuple[Start, ...] = field(default=(), repr=False)
    held: Sight | None = field(default=None, repr=False)
    place: int | None = field(default=None, repr=False)

    def after(self, sight: Sight) -> Watch:
        """The state after one more picture."""
        steady = self.steady or Filters.blank(sight.of_calibration.shape[1], sight.of_place.shape[1])
        now = replace(self, steady=steady, place=sight.place if self.place is None else self.place)
        if self.alarm is not None:
            return _judged(_fed(now, sight), sight)
        chance = _own_chance(now, sight)
        held = now.held
        if held is None and chance < ODD and self.count:
            return replace(now, held=sight, count=self.count + 1)
        if held is not None and chance > FITS:
            now = replace(now, held=None, poor=(*now.poor, held.name))
        elif held is not None:
            now = _judged(_fed(replace(now, held=None, count=now.count - 1), held), held)
        return _judged(_fed(now, sight), sight)


def watch(sights: Iterable[Sight], rule: Rule) -> Watch:
    """The state after all pictures."""
    state = Watch(rule)
    for sight in sights:
        state = state.after(sight)
    return state


def fit_since(sights: Sequence[Sight], since: int, *, noise: float = 1.0) -> tuple[Array, Array, float]:
    """The move (q,) since a picture with its covariance (q, q), and the squares over the noise that are left."""
    p, r, q = sights[0].of_calibration.shape[1], sights[0].of_place.shape[1], sights[0].of_move.shape[1]
    filters, place = Filters.blank(p, r), sights[0].place
    for i, sight in enumerate(sights):
        if sight.place != place:
            filters, place = filters.moved_on(slice(p, p + r)), sight.place
        if i == since:
            filters = filters.with_move(q)
        filters = filters.seen(*_over_noise(sight, with_move=i >= since))
    moves, covariances = filters.moves(q)
    left = filters.squares[0] - filters.vector[0] @ np.linalg.lstsq(filters.matrix[0], filters.vector[0], rcond=None)[0]
    return moves[0], noise * covariances[0], float(left) / noise


def _over_noise(sight: Sight, *, with_move: bool) -> tuple[Array, Array]:
    parts = [sight.of_calibration, sight.of_place, *([sight.of_move] if with_move else [])]
    A = np.concatenate([sight.off[:, None], *parts], axis=1)
    white = np.linalg.solve(np.linalg.cholesky(sight.covariance), A)
    return white[:, 0], white[:, 1:]


def _at_place(state: Watch, sight: Sight) -> Watch:
    """The filters at the picture's place."""
    if state.place == sight.place or state.steady is None:
        return state
    p = sight.of_calibration.shape[1]
    at = slice(p, p + sight.of_place.shape[1])
    bank = None if state.bank is None else state.bank.moved_on(at)
    return replace(state, steady=state.steady.moved_on(at), bank=bank, place=sight.place)


def _own_chance(state: Watch, sight: Sight) -> float:
    """Of a picture as far off, where nothing moved."""
    steady = _at_place(state, sight).steady
    if steady is None:
        return 1.0
    more = float((steady.seen(*_over_noise(sight, with_move=False)).chi2() - steady.chi2())[0])
    noise, freedom = _noise(state)
    return _chance(len(sight.off), more / noise, freedom)


def _noise(state: Watch) -> tuple[float, float]:
    """s^2 by the pictures so far, and its degrees of freedom."""
    steady, freedom = state.steady, state.rule.freedom
    if freedom == inf or steady is None:
        return 1.0, freedom
    found = (freedom + float(steady.chi2()[0])) / (freedom + steady.values)
    return max(1.0, found), freedom + steady.values


def _fed(state: Watch, sight: Sight) -> Watch:
    """The filters after the picture, with a start before it and without those that are too long ago."""
    state = _at_place(state, sight)
    steady, bank, q = state.steady, state.bank, sight.of_move.shape[1]
    if steady is None:
        return state
    starts = state.starts
    if state.alarm is None:
        fresh = steady.with_move(q)
        bank = fresh if bank is None else bank.beside(fresh)
        starts = (*starts, Start(state.count, sight.name, *_noise(state)))
        if len(starts) > state.rule.window + 1:
            rows = np.r_[0, 2 : len(starts)]  # the first of all stays: a camera may have been moved before
            bank, starts = bank.kept(rows), (starts[0], *starts[2:])
        steady = steady.seen(*_over_noise(sight, with_move=False))
    if bank is not None:
        bank = bank.seen(*_over_noise(sight, with_move=True))
    return replace(state, steady=steady, bank=bank, starts=starts, count=state.count + 1)


def _judged(state: Watch, sight: Sight) -> Watch:
    """The questions of the last picture answered."""
    bank, q = state.bank, sight.of_move.shape[1]
    if bank is None:
        return state
    moves, covariances = bank.moves(q)
    wide = covariances if sight.alike is None else covariances + sight.alike
    gains = np.einsum("wi,wi->w", moves, np.linalg.solve(wide, moves[..., None])[..., 0])
    chances = [_chance(q, g / s.noise, s.freedom) for g, s in zip(gains, state.starts)]
    best = int(np.argmax(gains / [s.noise for s in state.starts]))
    chance = min(1.0, len(chances) * min(chances))
    start = state.starts[best]
    state = replace(state, chance=chance, move=moves[best], covariance=start.noise * wide[best], since=start.index)
    if state.alarm is None and chance < 1 / state.rule.run:
        alarm = Alarm(start.index, state.count - 1, chance, start.name, sight.name)
        state = replace(state, alarm=alarm, bank=bank.kept(np.array([best])), starts=(start,))
    return state


def _chance(dims: int, value: float, freedom: float) -> float:
    if freedom == inf:
        return chi2_tail(dims, max(value, 0.0))
    return float(f_tail(dims, freedom, max(value, 0.0) / dims))


def joint_chi2(sights: Sequence[Sight]) -> tuple[float, int]:
    """Chi-square of all sights together where nothing moved, the calibration's error being one for all, and its
    degrees of freedom."""
    state = Watch(Rule())
    for sight in sights:
        state = _at_place(
            replace(
                state,
                steady=state.steady or Filters.blank(sight.of_calibration.shape[1], sight.of_place.shape[1]),
                place=sight.place if state.place is None else state.place,
            ),
            sight,
        )
        if state.steady is not None:
            state = replace(state, steady=state.steady.seen(*_over_noise(sight, with_move=False)))
    return (0.0, 0) if state.steady is None else (float(state.steady.chi2()[0]), state.steady.values)
