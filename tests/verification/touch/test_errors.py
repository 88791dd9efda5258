"""Errors at touched points: the predicted radius, and the correction of the camera."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import so3
from calibrant.verification.touch.errors import Touch, corrected, correction_of, left_out, radius_95
from calibrant.verification.touch.result import joint_chance

PRIOR = np.diag([1e-3, 1e-3, 1e-3, 2e-3, 2e-3, 4e-3]) ** 2
DRAWN = np.diag([5e-4, 5e-4, 5e-4, 2e-4, 2e-4, 3e-4]) ** 2


def touches(rng: np.random.Generator, u: Array, count: int, *, noise: float = 1.0, turned: bool = True) -> list[Touch]:
    """Touches of a camera a metre above the table whose pose errs by u (6,)."""
    out = []
    for i in range(count):
        arm = rng.uniform([-0.3, -0.3, -1.1], [0.3, 0.3, -0.9])
        M = np.eye(6)
        M[3:, :3] = -so3.hat(arm)
        error = M @ u + noise * np.sqrt(np.diag(DRAWN)) * rng.normal(size=6)
        out.append(Touch(f"{i}", error[3:], error[:3] if turned else None, M @ PRIOR @ M.T, DRAWN, M))
    return out


@pytest.mark.parametrize("sigmas", [(1.0, 1.0, 1.0), (3.0, 1.0, 0.2), (1.0, 0.01, 0.01)])
def test_the_radius_holds_ninety_five_of_a_hundred(sigmas: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(0)
    length = np.linalg.norm(rng.normal(size=(100_000, 3)) * sigmas, axis=1)
    # Two moments of three leave a per cent or so; 100,000 draws 0.07 per cent.
    assert np.mean(length < radius_95(np.diag(sigmas) ** 2)) == pytest.approx(0.95, abs=0.012)


def test_a_correction_is_exact_on_exact_touches() -> None:
    u = np.array([1e-3, -2e-3, 5e-4, 3e-3, -1e-3, 2e-3])
    exact = touches(np.random.default_rng(1), u, 6, noise=0.0)
    # The prior draws it a little towards none: some per cent of sigma of what is known.
    assert correction_of(exact).error == pytest.approx(u, abs=0.2 * np.sqrt(PRIOR.diagonal()).max())
    after = [corrected(t, correction_of(exact)) for t in exact]
    assert max(np.linalg.norm(t.error) for t in after) < 0.05 * min(np.linalg.norm(t.error) for t in exact)


def test_one_touch_corrects_where_it_touched() -> None:
    u = np.array([0.0, 0.0, 0.0, 4e-3, 0.0, 0.0])
    one = touches(np.random.default_rng(2), u, 1, noise=0.0, turned=False)
    found = correction_of(one)
    assert np.linalg.norm(corrected(one[0], found).error) < 0.1 * np.linalg.norm(one[0].error)
    assert np.all(np.sqrt(np.diag(found.covariance)) <= np.sqrt(np.diag(PRIOR)) * 1.0001)


def test_no_touch_is_refused() -> None:
    with pytest.raises(InputError, match="a touch at the least"):
        correction_of([])


@pytest.mark.statistics
def test_errors_after_the_correction_are_as_predicted() -> None:
    """Of 300 corrections by five touches, the sixth is inside its 95 % region in 95 %, give or take 1.3 %."""
    rng, inside, squares, chances = np.random.default_rng(3), 0, [], []
    for _ in range(300):
        u = np.sqrt(np.diag(PRIOR)) * rng.normal(size=6)
        made = touches(rng, u, 6)
        found = correction_of(made[:5])
        inside += corrected(made[5], found).inside
        off = found.error - u
        squares.append(off @ np.linalg.solve(found.covariance, off))
        chances.append(joint_chance(made))
    assert 0.95 - 4 * 0.0126 < inside / 300 < 0.95 + 4 * 0.0126
    assert np.mean(squares) == pytest.approx(6, abs=4 * np.sqrt(12 / 300))
    assert np.mean(np.array(chances) < 0.5) == pytest.approx(0.5, abs=4 * np.sqrt(0.25 / 300))


def test_every_touch_is_checked_by_the_others() -> None:
    rng = np.random.default_rng(4)
    made = touches(rng, np.array([0, 0, 0, 5e-3, 5e-3, 0]), 5)
    before, after = (np.mean([np.linalg.norm(t.error) for t in ts]) for ts in (made, left_out(made)))
    assert after < 0.3 * before
