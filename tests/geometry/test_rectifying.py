"""After the turns both cameras look one way and the baseline lies along an axis."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.geometry.rectifying import rectifying_turns


@pytest.mark.parametrize(("t", "along", "sign"), [((0.12, 0.01, -0.02), 0, 1), ((0.01, -0.3, 0.02), 1, -1)])
def test_both_look_one_way_along_an_axis(t: tuple[float, float, float], along: int, sign: int) -> None:
    T_left_right = se3.make(so3.exp([0.05, -0.1, 0.02]), t)
    R, axis, baseline = rectifying_turns(T_left_right)
    np.testing.assert_allclose(R[0] @ T_left_right[:3, :3] @ R[1].T, np.eye(3), atol=1e-14)
    expected = np.zeros(3)
    expected[along] = sign * np.linalg.norm(t)
    np.testing.assert_allclose(R[0] @ t, expected, atol=1e-14)
    assert (axis, np.sign(baseline)) == (along, sign)
    assert abs(baseline) == pytest.approx(np.linalg.norm(t))


@pytest.mark.parametrize(("t", "words"), [((0, 0, 0), "stands where a is"), ((0.01, 0, 0.2), "before or behind a")])
def test_cameras_without_common_rows_are_refused(t: tuple[float, float, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        rectifying_turns(se3.make(np.eye(3), t), names=("a", "b"))
