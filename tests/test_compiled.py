"""Compiled functions: right, refused for other types, and loaded without what only a compilation needs."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from numba import types

from calibrant.compiled import compiled


@compiled(types.float64(types.float64[::1], types.float64))
def scaled_sum(values, divisor):  # type: ignore[no-untyped-def]
    total = 0.0
    for v in values:
        total += v
    return total / divisor


def test_it_computes_what_it_says() -> None:
    assert scaled_sum(np.array([1.0, 2.0]), 2.0) == 1.5
    assert scaled_sum(np.array([1.0]), 0.0) == np.inf


def test_other_types_are_refused() -> None:
    with pytest.raises(TypeError):
        scaled_sum(np.array(["a"]), 1.0)


def test_a_function_in_the_cache_loads_without_the_compiler() -> None:
    """Numba's array functions bring SciPy's linear algebra: a sign of all that a compilation asks for."""
    script = "import sys, calibrant.optimize.linear_kernels; print('scipy.linalg' in sys.modules)"
    for _ in range(2):  # the first may have to compile
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
