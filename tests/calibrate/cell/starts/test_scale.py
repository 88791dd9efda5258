"""The scale of target poses by the robot's motion: exact without noise, nearly unmoved by wrong poses."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.calibrate.cell.starts.scale import scale_of_target
from calibrant.calibrate.solvers.relative import PosePairs
from calibrant.geometry import se3, so3


def pairs(rng: np.random.Generator, n: int, scale: float, *, wrong: int = 0) -> PosePairs:
    A = se3.make(so3.random(rng, n), rng.normal(scale=0.3, size=(n, 3)))
    X, Z = se3.make(so3.random(rng, 2), rng.normal(scale=0.3, size=(2, 3)))
    B = se3.inverse(X) @ se3.inverse(A) @ Z
    B[:, :3, 3] /= scale
    B[:wrong] = se3.make(so3.random(rng, wrong), rng.normal(scale=0.3 / scale, size=(wrong, 3)))
    return PosePairs(A, B)


@pytest.mark.parametrize("scale", [1e-3, 0.5, 1.0, 40.0])
def test_exact(scale: float) -> None:
    assert scale_of_target(pairs(np.random.default_rng(0), 8, scale)) == pytest.approx(scale, rel=1e-9)


def test_a_fifth_of_wrong_poses() -> None:
    """36 of 100 motions are wrong."""
    assert scale_of_target(pairs(np.random.default_rng(1), 20, 3.0, wrong=4)) == pytest.approx(3.0, rel=5e-3)


def test_turning_on_the_spot_tells_no_scale() -> None:
    rng = np.random.default_rng(2)
    A = se3.make(so3.random(rng, 8), np.zeros((8, 3)))
    X, Z = se3.make(so3.random(rng, 2), rng.normal(scale=0.3, size=(2, 3)))
    assert np.isnan(scale_of_target(PosePairs(A, se3.inverse(X) @ se3.inverse(A) @ Z)))
