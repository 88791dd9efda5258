"""A target of another size than said: sigma holds what it does to the camera; one that is as said costs nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calibrant as cb
from calibrant.calibrate.cell.certainty import size
from calibrant.calibrate.cell.certainty.doubts import doubted
from calibrant.calibrate.cell.certainty.size import size_doubt
from calibrant.data import Measured
from calibrant.geometry import se3
from calibrant.simulate.cell import make_cell, observe_cell
from calibrant.simulate.truth import chi_square


def test_a_size_that_agrees_is_hardly_doubted_and_one_that_does_not_is_off_by_what_it_says() -> None:
    assert size_doubt(Measured(1.0, 1e-3)) < 0.03e-6
    assert size_doubt(Measured(1.001, 1e-3)) < 0.1e-6
    assert np.sqrt(size_doubt(Measured(1.006, 1e-3))) == pytest.approx(0.006, rel=0.1)
    assert np.sqrt(size_doubt(Measured(1.1, 1e-3))) == pytest.approx(0.1, rel=0.1)
    doubts = [size_doubt(Measured(1 + k * 1e-4, 1e-3)) for k in range(60)]
    assert np.all(np.diff(doubts) > 0)


def test_a_size_is_doubted_by_all_that_tell_it() -> None:
    """Two boards, both of them two sigma larger by the motion and alike to a fifth of that by the cameras."""
    sigma, alike = 5e-4, 1e-4
    C = sigma**2 * np.array([[1.0, 1 - alike**2 / sigma**2 / 2], [1 - alike**2 / sigma**2 / 2, 1.0]])
    both = doubted(C, np.full(2, 2 * sigma), size.size_groups(2), size.SPREADS).off
    alone = size_doubt(Measured(1 + 2 * sigma, sigma))
    assert np.all(np.diag(both) < 0.2 * alone)
    apart = doubted(C, np.array([2 * sigma, 2 * sigma + 6 * alike]), size.size_groups(2), size.SPREADS).off
    assert np.sqrt(apart[1, 1]) > 3 * alike


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("larger", [1.003, 1.01])
def test_sigma_holds_what_a_wrong_size_does(setup: str, larger: float) -> None:
    cell = make_cell(2, setup=setup)  # type: ignore[arg-type]
    seen = observe_cell(cell, sigma_px=0.1)
    typed = replace(seen, views=tuple(replace(v, points=larger * v.points) for v in seen.views))
    result = cb.calibrate_hand_eye(cell.robot_poses, typed, setup=setup)
    camera = result.transforms[0]
    assert chi_square(se3.local(cell.X, camera.matrix), camera.covariance) < 22.5  # 99.9 % of 6 degrees of freedom
    assert result.check("target-size").status == ("warn" if larger > 1.005 else "ok")
    assert "sigma holds" in result.check("target-size").message
