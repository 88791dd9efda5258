"""Robots that cannot be: refused where they are made."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.robots.chain import Joint
from calibrant.robots.poe import ProductOfExponentials


def test_a_joint_of_an_unknown_kind() -> None:
    with pytest.raises(InputError, match="joint 'a1': unknown kind 'ball'; expected revolute or prismatic"):
        Joint("a1", kind="ball")  # type: ignore[arg-type]


def test_axes_that_are_not_one_a_joint() -> None:
    with pytest.raises(InputError, match=r"2 joints need a direction and a point each, shape \(2, 3\); got \(1, 3\)"):
        ProductOfExponentials((Joint("a"), Joint("b")), np.eye(3)[:1], np.zeros((2, 3)), np.eye(4))
