"""Values of options that hold for one camera of a pair or for both, as `by_camera` has them for any number."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from calibrant.tasks.inputs.by_camera import files_by_camera, one_by_camera, several_by_camera

SIDES = ("left", "right")


def one_by_side(values: Sequence[str], *, option: str) -> dict[str, str]:
    """One value a side. Raises: InputError for two values of one side."""
    return one_by_camera(values, SIDES, option=option, every="both sides")


def named_by_side(values: Sequence[str], *, option: str) -> dict[str, Path]:
    """Files of the sides that are named. Raises: InputError for one without a side."""
    return files_by_camera(values, SIDES, option=option)


def several_by_side(values: Sequence[str], *, option: str) -> dict[str, tuple[str, ...]]:
    """Any number of values a side. Raises: InputError where a plain one follows one of a side in the same word."""
    return several_by_camera(values, SIDES, option=option, every="both")
