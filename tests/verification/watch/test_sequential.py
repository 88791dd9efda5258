"""The sequential test: exact on what it is told, silent where nothing moves, quick where something does."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.verification.watch.sequential import Rule, Sight, Watch, fit_since, watch

NOISE = 0.3


def drawn(
    n: int, rng: np.random.Generator, *, push: Array | None = None, at: int = 0, stay: int = 1, noise: float = NOISE
) -> list[Sight]:
    """Pictures by the model: a calibration's error of unit variance in ten directions, a robot's at every place."""
    A0, b, place, out = rng.normal(size=(6, 10)), rng.normal(size=10), -1, []
    A, B, H, r = A0, np.eye(6), np.eye(6), np.zeros(6)
    for i in range(n):
        if i % stay == 0:
            place, r = place + 1, rng.normal(size=6)
            A, B = A0 + 0.5 * rng.normal(size=(6, 10)), np.eye(6) + 0.1 * rng.normal(size=(6, 6))
            H = np.eye(6) + 0.2 * rng.normal(size=(6, 6))
        off = A @ b + B @ r + noise * rng.normal(size=6)
        off = off if push is None or i < at else off + H @ push
        out.append(Sight(f"{i}", off, A, B, place, H, NOISE**2 * np.eye(6), of_other=np.eye(6)))
    return out


def test_a_move_is_exact_where_nothing_else_errs() -> None:
    rng = np.random.default_rng(1)
    push = np.array([0.1, -0.2, 0.3, 1.0, 2.0, -3.0])
    sights = [
        Sight(s.name, s.of_move @ push * (i >= 4), s.of_calibration, s.of_place, s.place, s.of_move, s.covariance)
        for i, s in enumerate(drawn(30, rng))
    ]
    move, covariance, left = fit_since(sights, 4)
    assert move == pytest.approx(push, abs=0.02)  # unit priors of b and r draw a little at what is explained by none
    assert np.all(np.linalg.eigvalsh(covariance) > 0)
    assert left < 1.0


def test_the_filters_give_what_one_solution_of_all_pictures_gives() -> None:
    """The bank's move against the dense least squares with every place's error an unknown of its own."""
    rng = np.random.default_rng(2)
    sights = drawn(12, rng, push=np.full(6, 2.0), at=5, stay=3)
    places = max(s.place for s in sights) + 1
    rows, y = [], []
    for i, s in enumerate(sights):
        row = np.zeros((6, 10 + 6 * places + 6))
        row[:, :10] = s.of_calibration
        row[:, 10 + 6 * s.place : 16 + 6 * s.place] = s.of_place
        row[:, -6:] = s.of_move * (i >= 5)
        rows.append(row / NOISE)
        y.append(s.off / NOISE)
    A, prior = np.concatenate(rows), np.diag(np.r_[np.ones(10 + 6 * places), np.zeros(6)])
    C = np.linalg.inv(A.T @ A + prior)
    expected = C @ A.T @ np.concatenate(y)
    move, covariance, _ = fit_since(sights, 5)
    assert move == pytest.approx(expected[-6:], rel=1e-8)
    assert covariance == pytest.approx(C[-6:, -6:], rel=1e-8)


def test_a_move_is_named_within_ten_pictures_and_since_when() -> None:
    sights = drawn(50, np.random.default_rng(3), push=np.full(6, 3.0), at=30)
    state = watch(sights, Rule())
    assert state.alarm is not None
    assert abs(state.alarm.since - 30) <= 1
    assert 30 <= state.alarm.at < 40
    assert state.move == pytest.approx(np.full(6, 3.0), abs=5 * np.sqrt(np.diag(np.asarray(state.covariance))).max())


def test_a_single_poor_picture_is_left_out() -> None:
    sights = drawn(40, np.random.default_rng(4))
    poor = sights[20]
    sights[20] = Sight("poor", poor.off + 50, *(getattr(poor, f) for f in ("of_calibration", "of_place", "place")),
                       poor.of_move, poor.covariance)  # fmt: skip
    state = watch(sights, Rule())
    assert state.alarm is None
    assert state.poor == ("poor",)


def test_a_camera_moved_before_the_first_picture_is_told_against_the_calibration() -> None:
    state = watch(drawn(20, np.random.default_rng(5), push=np.full(6, 25.0), at=0), Rule())
    assert state.alarm is not None
    assert state.alarm.since <= 1


def test_noise_beyond_what_is_stated_raises_the_limit_not_an_alarm() -> None:
    """Three times the noise: the pictures themselves tell it."""
    state = watch(drawn(120, np.random.default_rng(6), noise=3 * NOISE), Rule(freedom=18))
    assert state.alarm is None
    assert state.starts[-1].noise > 1.0


def test_pictures_from_one_place_do_not_average_the_robots_error() -> None:
    """A robot that stands still errs by the same in every picture: forty of them prove no move."""
    rng = np.random.default_rng(7)
    assert all(watch(drawn(80, rng, stay=40), Rule()).alarm is None for _ in range(5))


def test_a_run_of_one_picture_is_refused() -> None:
    with pytest.raises(InputError, match="2 or more"):
        Rule(run=1)


@pytest.mark.statistics
def test_false_alarms_are_as_rare_as_stated() -> None:
    """At one in 500 pictures, 3000 pictures: 6 expected at most, and more than 13 has a chance of 1 in 200. The test
    asks all its questions as if they were independent, so that there are fewer."""
    rng, alarms = np.random.default_rng(8), 0
    for _ in range(12):
        state = Watch(Rule(run=500, freedom=18))
        for sight in drawn(250, rng):
            state = state.after(sight)
        alarms += state.alarm is not None
    assert alarms <= 13


@pytest.mark.statistics
def test_the_moves_sigma_is_right() -> None:
    rng, squares = np.random.default_rng(9), []
    for _ in range(100):
        push = rng.normal(size=6)
        move, covariance, _ = fit_since(drawn(14, rng, push=push, at=7), 7)
        squares.append((move - push) @ np.linalg.solve(covariance, move - push))
    # Mean of chi-square of 6: 6 with a sigma of sqrt(12 / 100).
    assert np.mean(squares) == pytest.approx(6, abs=4 * np.sqrt(12 / 100))
