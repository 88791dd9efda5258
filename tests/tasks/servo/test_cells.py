"""`servo run` and `servo conveyor`: what cannot be asked is named before a cell is made."""

from __future__ import annotations

import pytest

import calibrant as cb
from calibrant.errors import InputError


def test_what_cannot_be_asked_is_named() -> None:
    for own in (cb.servo_run, cb.servo_conveyor):
        with pytest.raises(InputError, match="simulated cells"):
            own()
        with pytest.raises(InputError, match="seeds 0"):
            own(cell=True, seeds=0)
    with pytest.raises(InputError, match="choose image"):
        cb.servo_run(cell=True, control="fuzzy")
    with pytest.raises(InputError, match="overshoots"):
        cb.servo_run(cell=True, gain=9.0)
    with pytest.raises(InputError, match="belts run"):
        cb.servo_conveyor(cell=True, speed="3m")
