"""What the doctor says of a stereo pair that contradicts itself: a fault of the data is named, not averaged."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from calibrant.errors import RefusedError, causes

if TYPE_CHECKING:
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult, Observations

ASKED_AT = ("at-once", "cameras-moved", "rigidity", "together-", "epipolar")
"""Checks, by how their names begin, that say that pairs contradict each other."""
APPLY = "--apply is an option of calibrant doctor, which takes the same images and calibrates from repaired data"


def contradicts_itself(result: CalibrationResult) -> bool:
    """Whether a check says that pairs do not belong together."""
    return any(c.status != "ok" and c.name.startswith(ASKED_AT) for c in result.checks)


def faults_of_pairs(
    observations: Observations, *, cameras: Mapping[str, Camera], model: Mapping[str, str], photos: bool
) -> str | None:
    """What the doctor says of data that no calibration may pass: pictures out of step, exchanged, mirrored, of another
    camera, or cameras that moved; None for sound data. cameras: known ones by name; model: of the others; photos:
    whether there are images to repair."""
    from calibrant.diagnose.doctor.pairs.case import lenses
    from calibrant.diagnose.doctor.pairs.diagnosis import diagnose_pairs

    try:
        found = diagnose_pairs(observations, lens=lenses(cameras, model))
    except RefusedError:
        return None  # pairs too few to outvote one, or a lens that is found in the whole alone
    failed = [f for f in found.findings if f.status == "fail"]
    if not failed:
        return None
    repairable = photos and all(f.repair is not None for f in failed)
    said = causes(f"{f.name}: {f.text if photos else f.message}" for f in failed)
    return f"{said}. {APPLY}" if repairable else said
