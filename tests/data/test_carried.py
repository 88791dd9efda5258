"""Points carried from another camera's: checked once, cut with their view, kept by the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.data.observations import Carried
from calibrant.data.result_file import read_observations, write_observations
from calibrant.errors import InputError

UV, Q = np.arange(6.0).reshape(3, 2), np.arange(6.0, 12.0).reshape(3, 2)
SLOPE = np.arange(12.0).reshape(3, 2, 2)
VIEW = cb.View("0", np.zeros((3, 3)), Q, np.arange(3), "projector", carried=Carried("camera", UV, SLOPE))


def test_a_subset_takes_its_share() -> None:
    part = VIEW.subset(np.array([True, False, True]))
    assert part.carried is not None
    np.testing.assert_array_equal(part.carried.uv, UV[[0, 2]])
    np.testing.assert_array_equal(part.carried.slope, SLOPE[[0, 2]])


def test_the_file_keeps_it(tmp_path: Path) -> None:
    seen = cb.Observations((VIEW,), {"projector": (20, 10)})
    back = read_observations(write_observations(seen, tmp_path / "o.json")).views[0].carried
    assert back is not None
    assert back.camera == "camera"
    np.testing.assert_array_equal(back.uv, UV)
    np.testing.assert_array_equal(back.slope, SLOPE)


def test_numbers_that_do_not_fit_are_refused() -> None:
    with pytest.raises(InputError, match="slope"):
        Carried("camera", UV, SLOPE[:2])
    with pytest.raises(InputError, match="3 points, but 2 are carried"):
        cb.View("0", np.zeros((3, 3)), Q, np.arange(3), carried=Carried("camera", UV[:2], SLOPE[:2]))
