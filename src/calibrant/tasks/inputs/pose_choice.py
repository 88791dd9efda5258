"""How a file of robot poses is meant, where the data themselves can tell: each reading is tried, the best is taken."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np

from calibrant.cancel import CancelledError, checkpoint
from calibrant.errors import CalibrantError, InputError, RefusedError

if TYPE_CHECKING:
    from calibrant.formats.poses.read import PoseNotation, RawPoses

T = TypeVar("T")

CLEARLY = 2.0
"""A reading is right when every other leaves twice its misfit: wrong units or rotations leave a hundred times."""


@dataclass(frozen=True, eq=False)
class Chosen(Generic[T]):
    """The reading that fits, and what it gave."""

    reading: PoseNotation
    outcome: T


def best_reading(
    raw: RawPoses,
    attempt: Callable[[PoseNotation], T],
    misfit: Callable[[T], float],
    *,
    fits: Callable[[T], bool] = lambda outcome: True,
    what: str = "",
    credible: Callable[[T], bool] = lambda outcome: True,
) -> Chosen[T]:
    """The reading whose outcome misfits least.

    Args: attempt, what to do with a reading (a CalibrantError rules it out); misfit of its outcome; fits, whether an
    outcome can be right at all, and what to say when none is; credible, whether an outcome is good enough that another
    reading as good would leave a choice: of readings that are all wrong the best is returned, for its own checks.
    Raises: the best reading's own error when none works; RefusedError when none fits; InputError when two different
    readings fit equally well.
    """
    from calibrant.formats.poses.read import notations

    tried: list[tuple[float, Chosen[T]]] = []
    failure: CalibrantError | None = None
    for reading in notations(raw):
        checkpoint()
        try:
            outcome = attempt(reading)
        except CancelledError:
            raise
        except CalibrantError as error:
            failure = failure or error
            continue
        tried.append((misfit(outcome), Chosen(reading, outcome)))
    if not tried:
        raise failure or InputError("the poses can be read in no way")
    tried.sort(key=lambda item: item[0])
    (least, best), others = tried[0], tried[1:]
    if not fits(best.outcome):
        raise RefusedError(what)
    for other, rival in others if credible(best.outcome) else ():
        same = np.allclose(rival.reading.T_base_gripper, best.reading.T_base_gripper, atol=1e-9)
        if not same and other < CLEARLY * least:
            raise InputError(
                f"the poses fit equally well read as {best.reading.description} and as {rival.reading.description}; "
                "say which with --pose-units, --pose-rotation, --pose-angle, --pose-direction"
            )
    return best
