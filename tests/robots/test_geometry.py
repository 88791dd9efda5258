"""Geometric derivatives, joint offsets and conversions of every kind of chain, against differences."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.robots.arms import arm
from calibrant.robots.chain import Joint
from calibrant.robots.dh import DHRow, ModifiedDH, StandardDH
from calibrant.robots.geometry import ParametricChain, frame_about
from calibrant.robots.links import LinkChain, Mover, as_links
from calibrant.robots.poe import ProductOfExponentials, as_product_of_exponentials

STEP = 1e-6
TOLERANCE = 2e-9
"""Central differences of functions of size 1 with second derivatives of size 1: step^2 + 1e-16 / step, doubled."""


def scara() -> ModifiedDH:
    rows = (DHRow(0.0, 0.1, 0.4), DHRow(0.3, 0.2, 0.0, 0.1, 0.05), DHRow(0.25, np.pi, 0.05), DHRow(0.0, 0.0, 0.02, 0.3))
    joints = (Joint("j1"), Joint("j2"), Joint("z", 0.0, 0.2, "prismatic"), Joint("j4"))
    return ModifiedDH(rows, joints)


def gripper_arm() -> LinkChain:
    """Four movers on three joints: the third mimics the second, the fourth slides."""
    rng = np.random.default_rng(3)
    links = se3.make(so3.random(rng, 5), rng.normal(scale=0.3, size=(5, 3)))
    movers = (Mover("a"), Mover("b", (0, 1, 0)), Mover("b2", (1, 2, 0)), Mover("slide", (0, 0, 1), "prismatic"))
    joints = (Joint("a"), Joint("b"), Joint("slide", -1, 1, "prismatic"))
    mixing = np.array([[1, 0, 0], [0, 1, 0], [0, -0.5, 0], [0, 0, 1.0]])
    return LinkChain(joints, movers, links, mixing, np.array([0, 0, 0.2, 0]))


def bent_standard() -> StandardDH:
    rows = (DHRow(0.1, 0.4, 0.3, 0.2, 0.1), DHRow(0.5, 0.0, 0.0, 0.0, -0.2), DHRow(0.2, 1.5, 0.1))
    return StandardDH(rows, (Joint("a"), Joint("b"), Joint("s", -1, 1, "prismatic")))


CHAINS: dict[str, ParametricChain] = {
    "standard": bent_standard(),
    "modified": scara(),
    "links": gripper_arm(),
    "exponentials": as_product_of_exponentials(scara()),
}


@pytest.fixture(params=CHAINS)
def chain(request: pytest.FixtureRequest) -> ParametricChain:
    return CHAINS[request.param]


def configurations(chain: ParametricChain, count: int) -> np.ndarray:
    return np.random.default_rng(5).uniform(-1, 1, (count, len(chain.joints)))


def test_geometry_jacobian_is_the_difference(chain: ParametricChain) -> None:
    q = configurations(chain, 4)
    J = chain.geometry_jacobian(q)
    p = len(chain.parameters)
    assert J.shape == (4, 6, p)
    here = chain.forward(q)
    for k in range(p):
        step = STEP * np.eye(p)[k]
        up, down = (se3.local(here, chain.moved(s).forward(q)) for s in (step, -step))
        assert np.allclose(J[:, :, k], (up - down) / (2 * STEP), atol=TOLERANCE), chain.parameters[k]


def test_joint_jacobian_is_the_difference(chain: ParametricChain) -> None:
    q = configurations(chain, 4)
    J, here = chain.jacobian(q), chain.forward(q)
    for k in range(len(chain.joints)):
        step = STEP * np.eye(len(chain.joints))[k]
        up, down = (se3.local(here, chain.forward(q + s)) for s in (step, -step))
        assert np.allclose(J[:, :, k], (up - down) / (2 * STEP), atol=TOLERANCE)


def test_steps_lead_back(chain: ParametricChain) -> None:
    delta = np.random.default_rng(1).normal(scale=1e-2, size=len(chain.parameters))
    moved = chain.moved(delta)
    assert np.allclose(chain.steps_to(moved), delta, atol=1e-12)
    assert np.allclose(
        chain.with_state(moved.state).forward(np.zeros(len(chain.joints))), moved.forward(np.zeros(len(chain.joints)))
    )


def test_joint_offsets_become_geometry(chain: ParametricChain) -> None:
    q = configurations(chain, 5)
    offsets = np.linspace(0.02, -0.03, len(chain.joints))
    assert np.allclose(chain.with_joint_offsets(offsets).forward(q), chain.forward(q + offsets), atol=1e-12)


def test_batches_are_loops(chain: ParametricChain) -> None:
    q = configurations(chain, 6).reshape(2, 3, -1)
    assert np.allclose(chain.geometry_twists(q)[1, 2], chain.geometry_twists(q[1, 2]), atol=1e-15)
    assert np.allclose(chain.forward(q)[1, 2], chain.forward(q[1, 2]), atol=1e-15)


@pytest.mark.parametrize("convert", [as_links, as_product_of_exponentials])
def test_conversions_keep_the_poses(convert: object) -> None:
    for source in (arm("ur5e"), scara(), bent_standard()):
        q = configurations(source, 8)  # type: ignore[arg-type]
        assert np.allclose(convert(source).forward(q), source.forward(q), atol=1e-12)  # type: ignore[operator]


def test_product_of_exponentials_of_two_links_in_the_plane() -> None:
    # Modern Robotics, sec. 4.1: axes along z at the origin and at (L1, 0), home at (L1 + L2, 0).
    chain = ProductOfExponentials(
        (Joint("a"), Joint("b")),
        np.array([[0, 0, 1], [0, 0, 1]]),
        np.array([[0, 0, 0], [0.5, 0, 0]]),
        se3.make(np.eye(3), [0.8, 0, 0]),
    )
    expected = [0.5 * np.cos(0.4) + 0.3 * np.cos(1.1), 0.5 * np.sin(0.4) + 0.3 * np.sin(1.1), 0]
    assert np.allclose(chain.forward([0.4, 0.7])[:3, 3], expected, atol=1e-15)


def test_frame_about_any_direction() -> None:
    directions = np.array([[0, 0, 1.0], [0, 0, -1], [1, 0, 0], [0.6, -0.8, 0]])
    R = frame_about(directions)
    assert np.all(so3.is_rotation(R))
    assert np.allclose(R[:, :, 2], directions, atol=1e-15)


def test_what_is_no_chain_is_refused() -> None:
    with pytest.raises(InputError, match="axis has no direction"):
        ProductOfExponentials((Joint("a"),), np.zeros((1, 3)), np.zeros((1, 3)), np.eye(4))
    with pytest.raises(InputError, match="axis has no direction"):
        LinkChain((Joint("a"),), (Mover("a", (0, 0, 0)),), np.array([np.eye(4)] * 2))
    with pytest.raises(InputError, match="at least one moving joint"):
        LinkChain((), (), np.eye(4)[None])
    with pytest.raises(InputError, match="shape"):
        LinkChain((Joint("a"),), (Mover("a"),), np.eye(4)[None])
