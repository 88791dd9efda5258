"""Denavit-Hartenberg chains: published poses, derivatives, batches."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.robots.arms import ARMS, arm
from calibrant.robots.chain import Joint, KinematicChain
from calibrant.robots.dh import DHRow, ModifiedDH, StandardDH


def scara() -> ModifiedDH:
    """Two turning joints, a sliding one and a turning one."""
    rows = (DHRow(0.0, 0.0, 0.4), DHRow(0.3, 0.0, 0.0), DHRow(0.25, np.pi, 0.05), DHRow(0.0, 0.0, 0.02, 0.3))
    joints = (Joint("j1"), Joint("j2"), Joint("z", 0.0, 0.2, "prismatic"), Joint("j4"))
    return ModifiedDH(rows, joints)


CHAINS: dict[str, KinematicChain] = {**ARMS, "scara": scara()}


def test_two_links_in_the_plane_are_trigonometry() -> None:
    chain = StandardDH((DHRow(0.5, 0, 0), DHRow(0.3, 0, 0)), (Joint("a"), Joint("b")))
    T = chain.forward([0.4, 0.7])
    expected = [0.5 * np.cos(0.4) + 0.3 * np.cos(1.1), 0.5 * np.sin(0.4) + 0.3 * np.sin(1.1), 0]
    assert np.allclose(T[:3, 3], expected, atol=1e-15)
    assert np.allclose(T[:2, 0], [np.cos(1.1), np.sin(1.1)], atol=1e-15)


def test_ur5e_stands_where_its_table_says_at_zero() -> None:
    # Stretched out along -x: a2 + a3; -(d4 + d6) to the side; d1 - d5 up.
    T = arm("ur5e").forward(np.zeros(6))
    assert np.allclose(T[:3, 3], [-0.425 - 0.3922, -(0.1333 + 0.0996), 0.1625 - 0.0997], atol=1e-15)


def test_the_conventions_describe_one_arm() -> None:
    """A standard table, its x-screws moved one row on, is a modified table followed by the last x-screw."""
    rng = np.random.default_rng(0)
    table = rng.uniform(-1, 1, size=(4, 4))
    joints = tuple(Joint(f"j{i}") for i in range(4))
    standard = StandardDH(tuple(DHRow(*row) for row in table), joints)
    previous = np.vstack([[0, 0], table[:-1, :2]])
    modified = ModifiedDH(tuple(DHRow(a, alpha, d, t) for (a, alpha), (_, _, d, t) in zip(previous, table)), joints)
    last = StandardDH((DHRow(table[3, 0], table[3, 1], 0.0),), (Joint("end"),)).forward([0.0])
    q = rng.uniform(-2, 2, size=4)
    assert np.allclose(standard.forward(q), modified.forward(q) @ last, atol=1e-14)


@pytest.mark.parametrize("name", CHAINS)
def test_jacobian_is_the_difference_quotient(name: str) -> None:
    chain = CHAINS[name]
    n, h = len(chain.joints), 1e-6
    q = np.random.default_rng(1).uniform(chain.lower, chain.upper, size=(20, n))
    steps = h * np.eye(n)
    columns = [se3.local(chain.forward(q - s), chain.forward(q + s)) / (2 * h) for s in steps]
    # Central differences: h^2 of truncation and 1e-16 / h of rounding.
    assert np.abs(chain.jacobian(q) - np.stack(columns, axis=-1)).max() < 1e-8


@pytest.mark.parametrize("name", CHAINS)
def test_a_batch_is_a_loop(name: str) -> None:
    chain = CHAINS[name]
    q = np.random.default_rng(2).uniform(chain.lower, chain.upper, size=(2, 3, len(chain.joints)))
    for i in np.ndindex(2, 3):
        assert np.allclose(chain.forward(q)[i], chain.forward(q[i]), atol=1e-14)
        assert np.allclose(chain.jacobian(q)[i], chain.jacobian(q[i]), atol=1e-14)
    assert chain.within_limits(q).shape == (2, 3)


def test_limits() -> None:
    chain = scara()
    assert chain.within_limits([0, 0, 0.1, 0])
    assert not chain.within_limits([0, 0, 0.3, 0])


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="6 joints"):
        arm("ur5e").forward(np.zeros(5))
    with pytest.raises(InputError, match="NaN"):
        arm("ur5e").forward([np.nan] * 6)
    with pytest.raises(InputError, match="ur5e"):
        arm("puma560")
    with pytest.raises(InputError, match="the lower comes first"):
        Joint("j", 1.0, -1.0)
    with pytest.raises(InputError, match="as many rows as joints"):
        StandardDH((DHRow(0, 0, 0),), ())
