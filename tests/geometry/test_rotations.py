from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibrant.errors import InputError
from calibrant.geometry import rotations, so3


def elementary(letter: str, angle: float) -> np.ndarray:
    """Rotations about x, y and z as every textbook prints them."""
    c, s = np.cos(angle), np.sin(angle)
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[letter]


def product(order: str, angles: np.ndarray) -> np.ndarray:
    """Intrinsic: multiply on the right as the axes turn; extrinsic: on the left, about axes that stay."""
    R = np.eye(3)
    for letter, angle in zip(order, angles):
        R = R @ elementary(letter.lower(), angle) if letter.isupper() else elementary(letter, angle) @ R
    return R


def test_there_are_24_orders_and_they_are_all_there_can_be() -> None:
    tait_bryan = {"".join(p) for p in permutations("xyz")}
    proper = {a + b + a for a, b in permutations("xyz", 2)}
    everything = tait_bryan | proper
    assert set(rotations.EXTRINSIC_EULER_ORDERS) == everything
    assert set(rotations.INTRINSIC_EULER_ORDERS) == {s.upper() for s in everything}
    assert len(rotations.EULER_ORDERS) == 24


@pytest.mark.parametrize("order", rotations.EULER_ORDERS)
def test_euler_matrix_is_the_product_of_elementary_rotations(order: str) -> None:
    for angles in np.random.default_rng(7).uniform(-7, 7, size=(20, 3)):
        expected = product(order, angles)
        np.testing.assert_allclose(rotations.matrix_from_euler(angles, order=order, unit="rad"), expected, atol=1e-14)
        degrees = rotations.matrix_from_euler(np.rad2deg(angles), order=order, unit="deg")
        np.testing.assert_allclose(degrees, expected, atol=1e-14)


@pytest.mark.parametrize("order", rotations.EULER_ORDERS)
def test_euler_angles_agree_with_scipy(order: str) -> None:
    R = so3.random(np.random.default_rng(8), 200)
    ours = rotations.euler_from_matrix(R, order=order, unit="deg")
    # Near gimbal lock angles lose digits as 1e-16 / sin; none of these 200 is nearer than 0.5 degrees.
    np.testing.assert_allclose(ours, Rotation.from_matrix(R).as_euler(order, degrees=True), atol=1e-9)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("order", rotations.EULER_ORDERS)
@pytest.mark.parametrize("distance", [0.0, 1e-14, 1e-9, 1e-5], ids=str)
def test_gimbal_lock_gives_a_valid_representative(order: str, distance: float) -> None:
    proper = order[0] == order[2]
    for middle in (0.0, np.pi) if proper else (np.pi / 2, -np.pi / 2):
        R = product(order, np.array([0.7, middle + distance, -2.1]))
        angles = rotations.euler_from_matrix(R, order=order, unit="rad")
        np.testing.assert_allclose(product(order, angles), R, atol=2e-12)  # _LOCKED and rounding
        if distance == 0:
            assert angles[2 if order.isupper() else 0] == 0


@pytest.mark.parametrize("order", rotations.EULER_ORDERS)
def test_euler_angles_stay_in_their_ranges(order: str) -> None:
    first, middle, last = rotations.euler_from_matrix(
        so3.random(np.random.default_rng(9), 500), order=order, unit="deg"
    ).T
    low, high = (0, 180) if order[0] == order[2] else (-90, 90)
    assert low <= middle.min() <= middle.max() <= high
    assert max(np.abs(first).max(), np.abs(last).max()) <= 180


def test_yaw_pitch_roll_is_about_z_then_new_y_then_newest_x() -> None:
    yaw, pitch, roll = 0.3, -0.4, 0.5
    expected = elementary("z", yaw) @ elementary("y", pitch) @ elementary("x", roll)
    R = rotations.matrix_from_yaw_pitch_roll([yaw, pitch, roll], unit="rad")
    np.testing.assert_allclose(R, expected, atol=1e-15)
    np.testing.assert_allclose(rotations.matrix_from_euler([roll, pitch, yaw], order="xyz", unit="rad"), R, atol=1e-15)
    np.testing.assert_allclose(rotations.yaw_pitch_roll_from_matrix(R, unit="deg"), np.rad2deg([yaw, pitch, roll]))


def test_every_notation_names_the_same_quarter_turn() -> None:
    """A quarter turn about z takes x to y; written down by hand in every notation."""
    R = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    h = np.sqrt(0.5)
    made = [
        rotations.matrix_from_quaternion_wxyz([h, 0, 0, h]),
        rotations.matrix_from_quaternion_xyzw([0, 0, h, h]),
        rotations.matrix_from_axis_angle([0, 0, 2.5], 90, unit="deg"),
        rotations.matrix_from_rotation_vector([0, 0, np.pi / 2], unit="rad"),
        rotations.matrix_from_rotation_vector([0, 0, 90], unit="deg"),
        rotations.matrix_from_euler([90, 0, 0], order="ZYX", unit="deg"),
        rotations.matrix_from_euler([0, 0, 90], order="xyz", unit="deg"),
        rotations.matrix_from_euler([60, 0, 30], order="ZXZ", unit="deg"),
    ]
    for matrix in made:
        np.testing.assert_allclose(matrix, R, atol=1e-15)


def test_quaternions_keep_their_order_apart() -> None:
    q_wxyz = np.array([0.5, 0.1, -0.7, 0.5])
    q_wxyz /= np.linalg.norm(q_wxyz)
    R = rotations.matrix_from_quaternion_wxyz(q_wxyz)
    np.testing.assert_allclose(rotations.matrix_from_quaternion_xyzw(q_wxyz[[1, 2, 3, 0]]), R, atol=1e-15)
    np.testing.assert_allclose(Rotation.from_quat(q_wxyz[[1, 2, 3, 0]]).as_matrix(), R, atol=1e-15)
    np.testing.assert_allclose(rotations.quaternion_wxyz_from_matrix(R), q_wxyz, atol=1e-15)
    np.testing.assert_allclose(rotations.quaternion_xyzw_from_matrix(R), q_wxyz[[1, 2, 3, 0]], atol=1e-15)
    np.testing.assert_array_equal(rotations.xyzw_from_wxyz([1, 2, 3, 4]), [2, 3, 4, 1])
    np.testing.assert_array_equal(rotations.wxyz_from_xyzw([2, 3, 4, 1]), [1, 2, 3, 4])


@pytest.mark.parametrize("shape", [(), (1,), (3,), (2, 4)], ids=str)
def test_round_trips_over_batches(shape: tuple[int, ...]) -> None:
    n = int(np.prod(shape, dtype=int))
    R = so3.random(np.random.default_rng(10), n).reshape(*shape, 3, 3)
    r = rotations
    axis, angle = r.axis_angle_from_matrix(R, unit="deg")
    assert axis.shape == (*shape, 3)
    assert angle.shape == shape
    back = [
        r.matrix_from_axis_angle(axis, angle, unit="deg"),
        r.matrix_from_rotation_vector(r.rotation_vector_from_matrix(R, unit="deg"), unit="deg"),
        r.matrix_from_quaternion_wxyz(r.quaternion_wxyz_from_matrix(R)),
        r.matrix_from_quaternion_xyzw(r.quaternion_xyzw_from_matrix(R)),
        r.matrix_from_euler(r.euler_from_matrix(R, order="yzy", unit="deg"), order="yzy", unit="deg"),
    ]
    for matrix in back:
        assert matrix.shape == R.shape
        np.testing.assert_allclose(matrix, R, atol=1e-14)


def test_no_rotation_has_a_unit_axis() -> None:
    axis, angle = rotations.axis_angle_from_matrix(np.eye(3), unit="rad")
    np.testing.assert_array_equal(axis, [1, 0, 0])
    assert angle == 0


def test_a_matrix_from_a_file_is_put_right() -> None:
    R = so3.random(np.random.default_rng(11), 1)[0]
    again = rotations.matrix_from_euler(
        rotations.euler_from_matrix(np.round(R, 6), order="ZYX", unit="deg"), order="ZYX", unit="deg"
    )
    np.testing.assert_allclose(again, R, atol=2e-6)


def test_unknown_order_lists_the_valid_ones() -> None:
    with pytest.raises(InputError, match=r"unknown Euler order 'ZYx'.*XYZ.*zyz"):
        rotations.matrix_from_euler([0, 0, 0], order="ZYx", unit="deg")


def test_unit_has_no_default_and_must_be_known() -> None:
    with pytest.raises(TypeError, match="unit"):
        rotations.matrix_from_euler([0, 0, 0], order="ZYX")  # type: ignore[call-arg]
    with pytest.raises(InputError, match="'deg' or 'rad'"):
        rotations.matrix_from_euler([0, 0, 0], order="ZYX", unit="degrees")  # type: ignore[arg-type]


@pytest.mark.parametrize("quaternion", [[0, 0, 0, 0], [1, 0, np.nan, 0], [np.inf, 0, 0, 0]], ids=str)
def test_bad_quaternions_are_refused(quaternion: list[float]) -> None:
    with pytest.raises(InputError, match=r"norm 0|NaN"):
        rotations.matrix_from_quaternion_xyzw(quaternion)
    with pytest.raises(InputError, match=r"norm 0|NaN"):
        rotations.matrix_from_quaternion_wxyz([[1, 0, 0, 0], quaternion])


def test_bad_input_is_refused_by_name() -> None:
    with pytest.raises(InputError, match="axis has length 0"):
        rotations.matrix_from_axis_angle([0, 0, 0], 1.0, unit="rad")
    with pytest.raises(InputError, match=r"shape \(\.\.\., 3\), got \(4,\)"):
        rotations.matrix_from_rotation_vector([0, 0, 0, 1], unit="rad")
    with pytest.raises(InputError, match="NaN"):
        rotations.matrix_from_euler([0, np.nan, 0], order="XYZ", unit="deg")
    with pytest.raises(InputError, match="determinant -1"):
        rotations.quaternion_wxyz_from_matrix(-np.eye(3))
    with pytest.raises(InputError, match=r"differs from the identity by 3"):
        rotations.euler_from_matrix(2 * np.eye(3), order="ZYX", unit="deg")
