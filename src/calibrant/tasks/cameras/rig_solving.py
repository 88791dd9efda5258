"""The one way from a rig's images to its calibration: matched, searched, calibrated, looked at again."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from calibrant.errors import InputError
from calibrant.tasks.cameras.rig_pictures import ONLY_BOARD, RigPictures
from calibrant.tasks.inputs import session
from calibrant.tasks.inputs.by_partner import partner_notes
from calibrant.tasks.listener import Listener

if TYPE_CHECKING:
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult, Observations

ByMoment = Mapping[str, float] | Mapping[str, Mapping[str, float]]
Sizes = Mapping[str, tuple[int, int]]


@dataclass(frozen=True, eq=False)
class RigAsked:
    """What is asked of a rig, as `calibrate_rig` has it: one model and fix for all cameras, or by name."""

    cameras: Mapping[str, Camera] = field(default_factory=dict)
    initial: Mapping[str, Camera] = field(default_factory=dict)
    model: str | Mapping[str, str] = "brown"
    fix: tuple[str, ...] | Mapping[str, tuple[str, ...]] = ()
    reference: str | None = None
    time_offsets: bool = False
    readout: bool = False
    rigid: tuple[tuple[str, ...], ...] = ()


def solved_rig(pictures: RigPictures, asked_of: Callable[[Sizes], RigAsked], listener: Listener) -> CalibrationResult:
    """The rig, with how its images were matched, and those that showed no board.

    Args: asked_of: what is asked, from the image sizes by camera. Raises: InputError, RefusedError as the parts do.
    """
    from calibrant.data import Check

    times = pictures.times
    found = pictures.read()
    asked = asked_of({camera: size for seen in found.values() for camera, size in seen.image_sizes.items()})
    session.load_solver(listener)
    with listener.status("Calibrating …"):
        result = _calibrated(found, asked, times)
    more = pictures.look_again(found, result)
    if more is not found:
        with listener.status("Calibrating …"):
            result = _calibrated(more, asked, times)
        result = replace(result, notes=(*result.notes, *partner_notes(more.values())))
    if pictures.mirrored:
        result = replace(result, options={**result.options, "mirror_x": list(pictures.mirrored)})
    if pictures.matched:
        result = replace(result, checks=(Check("matching", "ok", pictures.matched), *result.checks))
    if pictures.own_times is not None:
        result = replace(result, checks=(Check("times", "ok", pictures.own_times.words), *result.checks))
    return result


def require_times(pictures: RigPictures, asked: Sequence[str], cure: str) -> None:
    """Raises: InputError where clocks are asked for, by these words, and nothing tells when pictures were taken."""
    if asked and not pictures.times:
        raise InputError(f"{asked[0]} needs the time of every picture: {cure}")


def _calibrated(found: Mapping[str, Observations], asked: RigAsked, times: ByMoment) -> CalibrationResult:
    from calibrant.calibrate.cell.rig import calibrate_rig

    return calibrate_rig(
        found if list(found) != [ONLY_BOARD] else found[ONLY_BOARD],
        cameras=asked.cameras,
        initial=asked.initial,
        model=asked.model,
        fix=asked.fix,
        reference=asked.reference,
        times=times,
        time_offsets=asked.time_offsets,
        readout=asked.readout,
        rigid=asked.rigid,
    )
