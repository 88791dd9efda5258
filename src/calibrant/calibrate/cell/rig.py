"""Rigs: several cameras fixed to each other that see one moving target at the same moments.

A rig is a cell without robots (`problem.layout`): its root is the reference camera's frame, the target is handheld,

    min sum |project(theta_c, T_root_c^-1 T_root_target_m p_j) - uv|^2 / sigma_c^2,

over all cameras, their places and one target pose a moment, the noise of every camera estimated from its residuals.
Of several targets each has its own pose a moment; those fixed to each other (`rigid`) have one pose together.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from calibrant.calibrate.cell.calibrate import CellFit, fit_cell, judged_cell
from calibrant.calibrate.cell.lens_choice import MODEL, FixForEach, ForEach, lenses_asked
from calibrant.calibrate.cell.problem.layout import HANDHELD, TARGET, Pictures
from calibrant.calibrate.intrinsics.fit import ORDINARY, Stopping
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Observations
from calibrant.errors import InputError
from calibrant.expected import expect

Seen = Observations | Mapping[str, Observations]
"""What the cameras saw of the only target, or of each by its name."""


def calibrate_rig(
    observations: Seen,
    *,
    cameras: Mapping[str, Camera] | None = None,
    initial: Mapping[str, Camera] | None = None,
    model: ForEach = MODEL,
    fix: FixForEach = (),
    reference: str | None = None,
    times: Mapping[str, float] | Mapping[str, Mapping[str, float]] | None = None,
    time_offsets: bool = False,
    readout: bool = False,
    rigid: Sequence[Sequence[str]] = (),
) -> CalibrationResult:
    """Calibrate cameras that are fixed to each other from synchronised views; `View.moment` says what is simultaneous.

    observations: of one target, or those of several by the target's name; rigid: names of those that are fixed to each
    other, group by group. One camera alone measures how these stand to each other.

    cameras: known intrinsics by name, held within their covariance (exact where they have none). The others are
    calibrated from their views: initial, by name, where that starts; model and fix, one for all cameras or by name,
    those not named having the default. Cameras may have different models and image sizes.
    times: seconds of every moment, by its name, or by camera and moment where each picture has a time of its own, which
    then counts. With them the cameras' clocks can be unknowns too: time_offsets, how late each camera is against the
    reference; readout, the time between a picture's first and last row.
    reference: the camera whose frame is the rig's, by default the first. The result's transforms lead from it to every
    other camera (parent: reference, child: camera), then between every two others, with their covariance, and its
    `joint_covariance` is over the former.
    Raises: InputError for unusable input; RefusedError when cameras share no moments or cannot be determined.

    Example::

        left = cb.View("left-0", points, uv_left, ids, "left", moment="0")
        right = cb.View("right-0", points, uv_right, ids, "right", moment="0")  # and so on: ten moments or more
        result = cb.calibrate_rig(cb.Observations((left, right), {"left": (1280, 1024), "right": (1280, 1024)}))
        result.transform("left", "right").matrix
    """
    fit = fit_rig(
        observations,
        cameras=cameras,
        initial=initial,
        model=model,
        fix=fix,
        reference=reference,
        times=times,
        time_offsets=time_offsets,
        readout=readout,
        rigid=rigid,
    )
    asked: dict[str, object] = {"time_offsets": True} if time_offsets else {}
    asked |= {"readout": True} if readout else {}
    asked |= {"rigid": [list(group) for group in rigid]} if rigid else {}
    return judged_cell(fit, asked_of_rig(model, fix, initial) | asked)


def asked_of_rig(model: ForEach, fix: FixForEach, initial: Mapping[str, Camera] | None) -> dict[str, object]:
    """The options as a rig's result holds them."""
    return {"model": dict(model) if isinstance(model, Mapping) else model} | lenses_asked(fix, initial)


def fit_rig(
    observations: Seen,
    *,
    cameras: Mapping[str, Camera] | None = None,
    initial: Mapping[str, Camera] | None = None,
    model: ForEach = MODEL,
    fix: FixForEach = (),
    reference: str | None = None,
    together: Collection[str] = (),
    times: Mapping[str, float] | Mapping[str, Mapping[str, float]] | None = None,
    time_offsets: bool = False,
    readout: bool = False,
    rigid: Sequence[Sequence[str]] = (),
    same_focal: bool = False,
    stop: Stopping = ORDINARY,
) -> CellFit:
    """The fit behind `calibrate_rig`; arguments and errors as there. together: as `fit_cell` has it; same_focal: of a
    rig of two; stop: every solver."""
    expect(observations, (Observations, Mapping), "observations", "Observations of two cameras or more")
    targets = {TARGET: observations} if isinstance(observations, Observations) else dict(observations)
    for target, seen in targets.items():
        expect(seen, Observations, f"the observations of {target}", "Observations")
    names = tuple(dict.fromkeys(name for seen in targets.values() for name in seen.image_sizes))
    if len(names) < 2 and not rigid:
        raise InputError(f"a rig has two cameras or more, the observations have {len(names)}: {', '.join(names)}")
    if reference is not None and reference not in names:
        raise InputError(f"no camera {reference!r} in the observations; known: {', '.join(names)}")
    return fit_cell(
        {},
        _pictures(targets, names),
        cameras=cameras,
        initial=initial,
        model=model,
        fix=fix,
        reference=reference or "",
        together=together,
        times=times,
        time_offsets=time_offsets,
        readout=readout,
        rigid=rigid,
        same_focal=(names[0], names[1]) if same_focal else (),
        stop=stop,
    )


def _pictures(targets: Mapping[str, Observations], names: Sequence[str]) -> list[Pictures]:
    """A list for every camera and target that it saw; of the only target for every camera."""
    return [
        Pictures(name, HANDHELD, seen.of_camera(name), target=target)
        for name in names
        for target, seen in targets.items()
        if name in seen.image_sizes and (len(targets) == 1 or seen.of_camera(name).views)
    ]
