"""Group axioms of SO(3) and SE(3) over batch shapes, with samples near the identity and near a half turn."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibrant.geometry import se3, so3

GROUPS = [pytest.param(so3, 3, id="so3"), pytest.param(se3, 6, id="se3")]
ANGLES = {"zero": 0.0, "tiny": 1e-7, "series-limit": 1e-4, "ordinary": 1.3, "almost-pi": np.pi - 1e-7}
SHAPES = [(), (3,), (2, 1, 4)]

# Elements and their products are sums of a dozen terms of order one: a few hundred roundings at worst.
EXACT = 1e-13

properties = settings(max_examples=40, deadline=None, derandomize=True, database=None)
seeds = st.integers(0, 2**32 - 1)
angles = st.sampled_from(sorted(ANGLES))
shapes = st.sampled_from(SHAPES)


def tangents(seed: int, angle: str, shape: tuple[int, ...], size: int) -> np.ndarray:
    """Tangent vectors (*shape, size) whose rotation has the named angle; translations of some metres."""
    x = np.random.default_rng(seed).normal(size=(*shape, size))
    x[..., :3] *= ANGLES[angle] / np.linalg.norm(x[..., :3], axis=-1, keepdims=True)
    return x


def inverse(group: ModuleType, element: np.ndarray) -> np.ndarray:
    return se3.inverse(element) if group is se3 else np.swapaxes(element, -1, -2)


@pytest.mark.parametrize(("group", "size"), GROUPS)
@properties
@given(seed=seeds, angle=angles, shape=shapes)
def test_log_inverts_exp(group: ModuleType, size: int, seed: int, angle: str, shape: tuple[int, ...]) -> None:
    x = tangents(seed, angle, shape, size)
    back = group.log(group.exp(x))
    assert back.shape == x.shape
    # Near pi the inverse Jacobian stretches rounding of the translation by up to pi / 2.
    np.testing.assert_allclose(back, x, atol=1e-12, rtol=0)


@pytest.mark.parametrize(("group", "size"), GROUPS)
@properties
@given(seed=seeds, angle=angles, shape=shapes)
def test_tiny_rotations_keep_their_relative_accuracy(
    group: ModuleType, size: int, seed: int, angle: str, shape: tuple[int, ...]
) -> None:
    x = tangents(seed, "tiny", shape, size)
    back = group.log(group.exp(x))
    # A matrix holds 1e-7 rad beside ones, to 1e-16; its off-diagonal elements hold it to 1e-23.
    np.testing.assert_allclose(back[..., :3], x[..., :3], rtol=1e-9)


@pytest.mark.parametrize(("group", "size"), GROUPS)
@properties
@given(seed=seeds, angle=angles, shape=shapes)
def test_minus_is_inverse(group: ModuleType, size: int, seed: int, angle: str, shape: tuple[int, ...]) -> None:
    x = tangents(seed, angle, shape, size)
    g = group.exp(x)
    identity = np.broadcast_to(np.eye(g.shape[-1]), g.shape)
    np.testing.assert_allclose(g @ group.exp(-x), identity, atol=10 * EXACT)
    np.testing.assert_allclose(g @ inverse(group, g), identity, atol=10 * EXACT)
    np.testing.assert_allclose(inverse(group, g) @ g, identity, atol=10 * EXACT)


@pytest.mark.parametrize(("group", "size"), GROUPS)
@properties
@given(seed=seeds, angle=angles, other=angles, shape=shapes)
def test_products_stay_in_the_group(
    group: ModuleType, size: int, seed: int, angle: str, other: str, shape: tuple[int, ...]
) -> None:
    product = group.exp(tangents(seed, angle, shape, size)) @ group.exp(tangents(seed + 1, other, shape, size))
    assert np.all(so3.is_rotation(product[..., :3, :3], tolerance=EXACT))
    np.testing.assert_allclose(group.exp(group.log(product)), product, atol=1e-12)


@pytest.mark.parametrize(("group", "size"), GROUPS)
@properties
@given(seed=seeds, angle=angles, shape=shapes)
def test_batch_equals_loop(group: ModuleType, size: int, seed: int, angle: str, shape: tuple[int, ...]) -> None:
    x = tangents(seed, angle, shape, size)
    batch = group.exp(x)
    for index in np.ndindex(shape):
        np.testing.assert_allclose(batch[index], group.exp(x[index]), atol=1e-15)
        np.testing.assert_allclose(group.log(batch)[index], group.log(batch[index]), atol=1e-15)


@properties
@given(seed=seeds, angle=angles, other=angles, shape=shapes)
def test_adjoint_moves_twists(seed: int, angle: str, other: str, shape: tuple[int, ...]) -> None:
    T, xi = se3.exp(tangents(seed, angle, shape, 6)), tangents(seed + 1, other, shape, 6)
    moved = np.einsum("...ij,...j->...i", se3.adjoint(T), xi)
    np.testing.assert_allclose(T @ se3.exp(xi) @ se3.inverse(T), se3.exp(moved), atol=1e-11)


@properties
@given(seed=seeds, angle=angles, other=angles, shape=shapes)
def test_local_inverts_retract(seed: int, angle: str, other: str, shape: tuple[int, ...]) -> None:
    T, delta = se3.exp(tangents(seed, angle, shape, 6)), tangents(seed + 1, other, shape, 6)
    np.testing.assert_allclose(se3.local(T, se3.retract(T, delta)), delta, atol=1e-11)


@properties
@given(seed=seeds, angle=angles, shape=shapes)
def test_left_jacobian_against_differences(seed: int, angle: str, shape: tuple[int, ...]) -> None:
    omega, h = tangents(seed, angle, shape, 3), 1e-5
    J = so3.left_jacobian(omega)
    R_inverse = np.swapaxes(so3.exp(omega), -1, -2)
    for i, e in enumerate(np.eye(3)):
        ahead, behind = (so3.log(so3.exp(omega + s * h * e) @ R_inverse) for s in (1, -1))
        # Central differences: h^2 / 6 = 2e-11 of truncation and 1e-16 / h = 1e-11 of rounding.
        np.testing.assert_allclose(J[..., i], (ahead - behind) / (2 * h), atol=1e-9)
    product = so3.left_jacobian_inverse(omega) @ J
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(3), product.shape), atol=1e-12)
