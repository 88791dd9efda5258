"""Does a depth camera measure true lengths? Boards whose size is known tell its scale."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.inputs.sources import Source
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.depth_cameras import DepthRigOptions
from calibrant.tasks.options.images import PhotoOptions, SearchOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.outcome import Outcome

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult, Check, Measured, Observations
    from calibrant.perceive.board_depth.board import DepthScale

EXAMPLE = 'cb.verify_depth("colour/*.png", depth="depth/*.png", camera="camera.json", target="chessboard:9x6:25mm")'


@dataclass(frozen=True, kw_only=True)
class Request:
    """Compare a depth camera's depths with boards seen in colour: their common scale, with its uncertainty.

    calibrant verify depth colour/*.png --depth depth/*.png --camera camera.json --target chessboard:9x6:25mm

    One depth picture a photo, in the same order. A scale of 1 % too long is 5 mm at half a metre.
    """

    photos: PhotoOptions = PhotoOptions()
    depth: Annotated[tuple[str, ...], Option("FILES")] = ()
    """Depth of each photo: 16-bit PNG in millimetres, or .npy in metres."""
    cameras: DepthRigOptions = DepthRigOptions()
    tolerance: Annotated[str, Option("PERCENT")] = "2%"
    """Fail where the scale is off by more than this, 95 % sure; by default what makers state."""
    search: SearchOptions = SearchOptions()


def reads(request: Request) -> list[Path]:
    """Photos, depth pictures and the cameras' file."""
    source = _source(request, SILENT)
    return [*source.inputs(source.files()), *_depth_files(request), request.cameras.file]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The scale. Raises: InputError, RefusedError as the parts do."""
    from calibrant.calibrate.pose.estimate import estimate_poses
    from calibrant.data.verdicts import refuse_if_failed
    from calibrant.detection.images.depth_files import read_depth
    from calibrant.perceive.board_depth.board import depth_scale

    depths, tolerance = _depth_files(request), _percent(request.tolerance)
    source = _source(request, listener)
    files = source.files()
    if len(files) != len(depths):
        raise InputError(f"{len(files)} photos and {len(depths)} depth pictures; expected one for each, in their order")
    found = source.read(files)
    session.load_solver(listener)
    rig = request.cameras.rig(next(iter(found.image_sizes.values())))
    with listener.status("Comparing depths …"):
        noise = estimate_poses(rig.colour, found).sigma_px
        of = {str(f): d for f, d in zip(files, depths)}
        pictures = [read_depth(of.get(str(v.file), depths[0])) for v in found.views]
        scale = depth_scale(found.views, pictures, rig, sigma_px=noise or _SIGMA_PX, noise=request.cameras.noise(rig))
    result = _result(request, found, scale, tolerance, [*source.inputs(files), *depths, request.cameras.file])
    refuse_if_failed(result)
    return Outcome(result=result)


_SIGMA_PX = 0.3
"""Of a corner, where nothing tells it."""


def _source(request: Request, listener: Listener) -> Source:
    return Source.of(request.photos, request.search, listener)


def _depth_files(request: Request) -> list[Path]:
    from calibrant.detection.images.depth_files import depth_files

    if not request.depth:
        raise InputError("nothing to compare with: --depth depth/*.png, a depth picture for each photo")
    return depth_files(request.depth)


def _percent(text: str) -> float:
    try:
        value = float(text.strip().removesuffix("%")) / 100
    except ValueError:
        value = -1.0
    if not text.strip().endswith("%") or not 0 < value < 1:
        raise InputError(f"--tolerance takes per cent, such as 1%; got {text!r}")
    return value


def _result(
    request: Request, found: Observations, scale: DepthScale, tolerance: float, files: list[Path]
) -> CalibrationResult:
    from calibrant.data import CalibrationResult, Measured, ViewResult
    from calibrant.data.results import verdict_of
    from calibrant.data.verdicts import stamp

    said = {name: (s, sigma) for name, s, sigma in scale.views}
    views = tuple(
        ViewResult(v.id, True, len(v), reason=f"{100 * said[v.id][0]:+.2f} ± {100 * said[v.id][1]:.2f} %")
        for v in found.views
    )
    checks = _checks(scale, tolerance)
    result = CalibrationResult(
        "depth-scale",
        verdict_of(checks),
        checks=checks,
        views=views,
        figures={"scale": Measured(scale.scale, scale.sigma), "spread": Measured(scale.spread)} | _offset(scale),
        options={"tolerance": request.tolerance},
        inputs=session.file_records(files),
        observations=found,
    )
    return stamp(replace(session.with_misses(result)))


def _offset(scale: DepthScale) -> dict[str, Measured]:
    from calibrant.data import Measured

    if scale.offset is None or scale.offset_sigma is None:
        return {}
    return {"offset": Measured(1e3 * scale.offset, 1e3 * scale.offset_sigma, "mm")}


def _checks(scale: DepthScale, tolerance: float) -> tuple[Check, ...]:
    from calibrant.data import Check

    long = "long" if scale.scale > 0 else "short"
    said = f"depths are {100 * abs(scale.scale):.2f} ± {100 * scale.sigma:.2f} % (1σ) too {long}"
    far = abs(scale.scale) > _SIGMAS * scale.sigma
    out = [Check("scale", "warn" if far else "ok", said if far else f"{said}: not more than chance", scale.scale)]
    missed = abs(scale.scale) > tolerance + _ONE_SIDED * scale.sigma
    unsure = not missed and abs(scale.scale) + _ONE_SIDED * scale.sigma > tolerance
    status = "fail" if missed else "warn" if unsure else "ok"
    words = {"fail": "missed", "warn": "not shown: more boards would tell", "ok": "kept, 95 % sure"}[status]
    out.append(Check("tolerance", status, f"{100 * tolerance:g} %: {words} ({said})", scale.scale))  # type: ignore[arg-type]
    return tuple(out)


_SIGMAS = 3.0
_ONE_SIDED = 1.645
"""Sigmas that 95 % lie below."""
