"""Pictures of devices are checked where they are made."""

import numpy as np
import pytest

from calibrant.data import Picture
from calibrant.errors import InputError


def test_a_picture_knows_its_size():
    assert Picture("0", np.zeros((480, 640, 3), np.uint8), 0.5, np.full((240, 320), np.nan, np.float32)).size == (
        640,
        480,
    )


@pytest.mark.parametrize(
    ("colour", "depth", "words"),
    [
        (np.zeros((4, 5), np.uint8), None, r"colour is \(4, 5\)"),
        (np.zeros((4, 5, 3)), None, "float64"),
        (np.zeros((4, 5, 3), np.uint8), np.zeros((4, 5), np.uint16), "uint16"),
    ],
)
def test_other_arrays_are_refused(colour, depth, words):
    with pytest.raises(InputError, match=words):
        Picture("0", colour, 0.0, depth)
