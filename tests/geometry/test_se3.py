from __future__ import annotations

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.geometry import se3, so3


def sample(n: int) -> np.ndarray:
    rng = np.random.default_rng(5)
    return se3.make(so3.random(rng, n), rng.normal(size=(n, 3)))


def test_apply_is_the_matrix_product() -> None:
    T, p = sample(4), np.random.default_rng(6).normal(size=(4, 3))
    homogeneous = np.einsum("nij,nj->ni", T, np.column_stack([p, np.ones(4)]))
    np.testing.assert_allclose(se3.apply(T, p), homogeneous[:, :3], atol=1e-14)


def test_retract_moves_along_the_parents_axes() -> None:
    T = se3.make(so3.exp([0, 0, np.pi / 2]), [1.0, 2.0, 3.0])
    np.testing.assert_allclose(se3.retract(T, [0, 0, 0, 0.1, 0, 0])[:3, 3], [1.1, 2.0, 3.0], atol=1e-15)
    # A turn leaves the origin of the child where it is: retract is not exp(delta) T.
    turned = se3.retract(T, [0.2, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(turned[:3, 3], [1.0, 2.0, 3.0], atol=1e-15)
    np.testing.assert_allclose(turned[:3, :3], so3.exp([0.2, 0, 0]) @ T[:3, :3], atol=1e-15)


def test_mean_takes_rotation_and_translation_apart() -> None:
    T = sample(3)
    mean = se3.mean(T, weights=[1.0, 2.0, 1.0])
    np.testing.assert_allclose(mean[:3, 3], (T[0, :3, 3] + 2 * T[1, :3, 3] + T[2, :3, 3]) / 4, atol=1e-15)
    np.testing.assert_allclose(mean[:3, :3], so3.mean(T[:, :3, :3], weights=[1, 2, 1]), atol=1e-15)


def test_check_frees_a_matrix_of_its_files_rounding() -> None:
    T = sample(1)[0]
    checked = se3.check(np.round(T, 5), name="T")
    assert so3.is_rotation(checked[:3, :3], tolerance=1e-14)
    np.testing.assert_allclose(checked, T, atol=2e-5)


def bad(index: tuple[int, ...], value: float) -> np.ndarray:
    T = sample(3)
    T[index] = value
    return T


@pytest.mark.parametrize(
    ("T", "message"),
    [
        (np.eye(3), r"T_a_b: expected 4x4"),
        (bad((1, 0, 3), np.nan), r"T_a_b\[1\] holds NaN"),
        (bad((2, 3, 0), 0.5), r"T_a_b\[2\]: the last row"),
        (bad((0, 0, 0), 2.0), r"T_a_b\[0\]: the upper left 3x3 block is not a rotation"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), r"determinant -1"),
    ],
    ids=["shape", "nan", "last-row", "no-rotation", "mirror"],
)
def test_check_names_what_is_wrong(T: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        se3.check(T, name="T_a_b")
