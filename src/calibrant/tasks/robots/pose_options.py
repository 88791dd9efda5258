"""Options that say how rotations are written, against the data.

With such an option wrong nothing fits, which looks like wrong pairs, a wrong target, or a robot that never turned.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from calibrant.errors import CalibrantError

if TYPE_CHECKING:
    from calibrant.diagnose.doctor.diagnosis import Diagnosis
    from calibrant.diagnose.doctor.evidence.finding import Finding
    from calibrant.formats.poses.read import RawPoses
    from calibrant.tasks.robots.hand_eye_list import ListRequest, PairedData

NAME = "pose-options"
_SAID = ("angle", "rotation")
"""Units of length and the direction have findings of their own, which the target and the setup share with them."""


def contradicted(
    data: PairedData,
    request: ListRequest,
    found: Diagnosis | None,
    diagnosed: Callable[[PairedData, ListRequest], Diagnosis],
) -> Finding | None:
    """The finding that an option contradicts the data: without it the loop closes, read in another way.

    Args: found, the diagnosis as the options say, None where it was refused; diagnosed, how another one is made.
    """
    from calibrant.diagnose.doctor.evidence.finding import Finding

    if data.raw is None or (found is not None and found.sound and found.poses.fits):
        return None
    for key in _SAID:
        said = getattr(request.form, f"pose_{key}")
        other = None if said == "auto" else _without(key, data.raw, data, request, diagnosed)
        if other is None or getattr(other.poses.notation, key) == said:
            continue
        loop = other.agreeing_loop
        closes = "the loop closes" if loop is None else f"the loop closes to {loop.text}"
        fits = (
            "it does not" if found is None or found.agreeing_loop is None else f"it leaves {found.agreeing_loop.text}"
        )
        message = (
            f"--pose-{key} {said} contradicts the data: read as {other.poses.notation.rotation_words} {closes}, "
            f"as said {fits}; leave --pose-{key} out, or say {getattr(other.poses.notation, key)}"
        )
        return Finding(NAME, "fail", message, other.poses.decision.confidence)
    return None


def _without(
    key: str,
    raw: RawPoses,
    data: PairedData,
    request: ListRequest,
    diagnosed: Callable[[PairedData, ListRequest], Diagnosis],
) -> Diagnosis | None:
    """The diagnosis without an option, where the loop closes then."""
    from calibrant.formats.poses.read import every_notation

    raw = replace(raw, options=replace(raw.options, **{key: "auto"}))
    try:
        every = every_notation(raw)
        complete = tuple(r.take(data.pose_index, data.complete[0].ids) for r in every)
        found = diagnosed(replace(data, complete=complete), request)
    except CalibrantError:
        return None
    return found if found.poses.decision.ok and found.poses.fits else None
