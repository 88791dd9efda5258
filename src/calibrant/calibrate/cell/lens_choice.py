"""What is asked of each camera of a cell: known, guessed or found, its model, and what of it is held."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from calibrant.calibrate.intrinsics.fit import ORDINARY, Stopping
from calibrant.cameras import Camera
from calibrant.data import DEFAULT_CAMERA
from calibrant.errors import InputError
from calibrant.expected import expect

ForEach = str | Mapping[str, str]
FixForEach = Sequence[str] | Mapping[str, Sequence[str]]
"""One for all cameras, or one by the camera's name; those not named have the default."""

MODEL = "brown"


@dataclass(frozen=True, kw_only=True, eq=False)
class LensChoice:
    """One camera: given (within its covariance, exact without one), or calibrated from its pictures with a model.

    fix: names of what is held; initial: where its calibration starts, and what is held is held at. together: its own
    views need not determine it: it starts at `initial` and is found in the whole alone, weak terms of distortion held
    near nothing (`weak_terms`). stop: when the solver of its own calibration does.
    """

    given: Camera | None = None
    initial: Camera | None = None
    model: str = MODEL
    fix: tuple[str, ...] = ()
    together: bool = False
    stop: Stopping = ORDINARY


def lens_choices(
    names: Sequence[str],
    *,
    cameras: Mapping[str, Camera] | None,
    initial: Mapping[str, Camera] | None,
    model: ForEach,
    fix: FixForEach,
    together: Collection[str] = (),
    stop: Stopping = ORDINARY,
) -> dict[str, LensChoice]:
    """The choice for each of the cameras that have pictures.

    Raises: InputError for a camera that has none, one that is both given and guessed, one that is found in the whole
    alone without a start.
    """
    known, guessed = _cameras(cameras, "cameras", names), _cameras(initial, "initial", names)
    for name in known:
        if name in guessed:
            raise InputError(
                f"camera {name!r} is given twice: known (held within its covariance) and as a guess to start from; "
                "leave one out"
            )
    _have_pictures(together, "`together`", names)
    for name in together:
        if name not in guessed:
            raise InputError(f"camera {name!r} is found together with the others: give where it starts (initial=…)")
    for what, value in (("`model`", model), ("`fix`", fix)):
        _have_pictures(value if isinstance(value, Mapping) else (), what, names)
    models: Mapping[str, str] = model if isinstance(model, Mapping) else dict.fromkeys(names, model)
    held: Mapping[str, Sequence[str]] = fix if isinstance(fix, Mapping) else dict.fromkeys(names, fix)
    return {
        n: LensChoice(
            given=known.get(n),
            initial=guessed.get(n),
            model=models.get(n, MODEL),
            fix=tuple(held.get(n, ())),
            together=n in together,
            stop=stop,
        )
        for n in names
    }


def lenses_asked(fix: FixForEach, initial: Mapping[str, Camera] | None = None) -> dict[str, object]:
    """The options as results hold them: what is not the default."""
    asked: dict[str, object] = {}
    if fix:
        asked["fix"] = {n: list(held) for n, held in fix.items()} if isinstance(fix, Mapping) else list(fix)
    return asked | ({"initial": sorted(initial)} if initial else {})


def _cameras(given: Mapping[str, Camera] | None, what: str, names: Sequence[str]) -> dict[str, Camera]:
    expect(given, (Mapping, type(None)), what, "known cameras by name")
    out = dict(given or {})
    for name, camera in out.items():
        expect(camera, Camera, f"the camera {name}" if name != DEFAULT_CAMERA else "camera", "a Camera")
    _have_pictures(out, "intrinsics", names)
    return out


def _have_pictures(said: Iterable[str], what: str, names: Sequence[str]) -> None:
    for name in said:
        if name not in names:
            raise InputError(f"{what} of camera {name!r}, which has no pictures; there are {', '.join(names)}")
