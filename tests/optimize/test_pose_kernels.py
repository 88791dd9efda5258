"""The compiled step of poses is `geometry.se3.retract`."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.geometry import se3
from calibrant.optimize import pose_kernels


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-5, 0.99e-4, 1.01e-4, 0.3, 3.0, 7.0])
def test_compiled_retract_is_the_readable_one(size: float) -> None:
    rng = np.random.default_rng(1)
    T = se3.exp(rng.normal(size=(20, 6)))
    delta = rng.normal(size=(20, 6))
    delta[:, :3] *= size / np.linalg.norm(delta[:, :3], axis=1, keepdims=True)
    moved = np.empty((20, 4, 4))
    pose_kernels.retract(T, delta, moved)
    # A few roundings of numbers of size one.
    np.testing.assert_allclose(moved, se3.retract(T, delta), rtol=0, atol=2e-15)
