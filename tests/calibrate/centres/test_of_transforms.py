"""Compiled centres of transforms against their readable forms, near half turns and with outliers too."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.arrays import Array
from calibrant.calibrate.centres import of_transforms as centres
from calibrant.geometry import se3, so3


def scattered(seed: int, n: int, angle: float) -> Array:
    """Transforms about a random one, `angle` rad and as many metres from it in each direction (1 sigma)."""
    rng = np.random.default_rng(seed)
    centre = se3.make(so3.random(rng, 1)[0], rng.normal(size=3))
    return se3.retract(np.tile(centre, (n, 1, 1)), rng.normal(scale=angle, size=(n, 6)))


@pytest.mark.parametrize("angle", [1e-9, 1e-3, 0.3, 0.8])
@pytest.mark.parametrize("n", [1, 2, 7, 20])
def test_means_are_those_of_the_readable_form(angle: float, n: int) -> None:
    T = scattered(n, n, angle)
    found = centres.mean(T)
    assert np.abs(found.T - se3.mean(T)).max() < 1e-12
    mm, deg = se3.deviation(found.T, T)
    assert found.mm == pytest.approx(mm, rel=1e-9, abs=1e-9)
    assert found.deg == pytest.approx(deg, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0.0, -0.8), (-0.48, 0.6, 0.64)])
@pytest.mark.parametrize("turn", [0.0, 1e-12, 1e-6, 1.0, 2.0, 2.2, np.pi - 1e-6])
def test_distances_are_those_of_the_readable_form(axis: tuple[float, float, float], turn: float) -> None:
    """Three alike hold the median where they are; the fourth is a turn about any axis, up to a half one, away."""
    T = np.repeat(scattered(3, 1, 1.0), 4, axis=0)
    for sign in (1.0, -1.0):
        T[3] = se3.retract(T[0], np.array([*(sign * turn * np.asarray(axis)), 0.1, -0.2, 0.3]))
        found = centres.median(T)
        mm, deg = se3.deviation(found.T, T)
        assert found.mm == pytest.approx(mm, rel=1e-9, abs=1e-9)
        assert found.deg == pytest.approx(deg, rel=1e-7, abs=1e-7)
        assert found.deg[3] == pytest.approx(np.rad2deg(turn), rel=1e-4, abs=1e-7)


def weiszfeld(T: Array) -> Array:
    """The iteration in its readable form: means weighted by 1 / length, until it moves by a thousandth of them."""
    R = T[:, :3, :3]
    angles = np.array([[so3.angle(a @ b.T) for b in R] for a in R])
    centre, t = R[int(np.argmin(angles.sum(axis=1)))], np.median(T[:, :3, 3], axis=0)
    for _ in range(30):
        settled = True
        steps = []
        for delta in (so3.log(R @ centre.T), T[:, :3, 3] - t):
            length = np.linalg.norm(delta, axis=1)
            weight = 1 / np.maximum(length, 1e-12)
            steps.append(weight @ delta / weight.sum())
            settled &= bool(np.linalg.norm(steps[-1]) <= 1e-3 * np.median(length))
        centre, t = so3.exp(steps[0]) @ centre, t + steps[1]
        if settled:
            break
    return se3.make(centre, t)


@pytest.mark.parametrize("n", [9, 10, 12, 20, 31])
def test_medians_are_those_of_the_readable_form_and_a_third_of_wrong_ones_hardly_moves_them(n: int) -> None:
    T = scattered(5, n, 1e-3)
    right = centres.median(T).T
    wrong = T.copy()
    wrong[: n // 3] = scattered(6, n // 3, 0.5)
    found = centres.median(wrong).T
    assert np.abs(right - weiszfeld(T)).max() < 1e-9
    assert np.abs(found - weiszfeld(wrong)).max() < 1e-9
    mm, deg = se3.deviation(right, found)
    assert mm < 3.0
    assert deg < 0.2


@pytest.mark.parametrize("period", [3, 9, 10])
def test_wrong_ones_in_step_do_not_start_a_median(period: int) -> None:
    """One of every few poses of a long session is one and the same wrong one, as of a frame that stuck."""
    n = 999
    right, wrong = scattered(1, n, 1e-3), scattered(2, 1, 1.0)[0]
    odd = np.arange(n) % period == 0
    found, clean = centres.median(np.where(odd[:, None, None], wrong, right)), centres.median(right[~odd])
    mm, deg = (float(x[0]) for x in se3.deviation(found.T, clean.T[None]))
    assert mm < 2
    assert deg < 0.1


def test_the_start_is_drawn_from_the_whole() -> None:
    rows = centres._drawn(1000)
    assert len(set(rows.tolist())) == centres.START_CANDIDATES
    assert len(set((rows % 2).tolist())) == len(set((rows % 4).tolist())) / 2 == 2
