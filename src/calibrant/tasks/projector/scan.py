"""Scan a scene: the patterns' photos decoded, a point for every pixel with its sigma, a cloud."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.inputs.captures import capture_folders, files_of, read_captured
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.patterns import CODES, sequence_of
from calibrant.tasks.outcome import Document, Outcome
from calibrant.tasks.pictures import encoded

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult, Check
    from calibrant.detection.structured_light.capture import Capture
    from calibrant.patterns.sequence import PatternSequence
    from calibrant.perceive.scan.points import Scan
    from calibrant.perceive.stereo.eyes import Eyes

EXAMPLE = 'cb.scan("projector.json", capture="scene", cloud="scene.ply")'
AUTO = "auto"
MOST_ACROSS = 2.0
"""Of sigma: what is left across the epipolar lines is noise, and twice that is another calibration."""
NO_SIGMA = 10.0
"""Of sigma: what is off by ten times as much is of another geometry, and a sigma that small says nothing of it."""
FEW = 0.02
"""Part of the camera's picture."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Measure a scene by the patterns that a calibrated projector shows on it: a cloud with the sigma of every point.

    calibrant scan projector.json --capture scene --cloud scene.ply

    The capture is a folder with the photos of all patterns, in order, nothing moving. The cloud (PLY) is in the
    camera's frame, in metres, in the grey of the white picture, and has for every point sigma_z and its parts by the
    pixels and by the calibration.
    """

    result: Annotated[Path, Option("RESULT", positional=True)]
    """The projector's calibration, a result file."""
    capture: Annotated[Path, Option("DIR")]
    """The folder with the photos of the patterns."""
    cloud: Annotated[Path | None, Option("FILE.ply", output="file")] = None
    """Write the points here."""
    picture: Annotated[Path | None, Option("FILE.png", output="file")] = None
    """Draw the depths in colours, near red and far blue."""
    code: Annotated[str, Option("auto|gray|phase|both", choices=(AUTO, *CODES))] = AUTO
    """The patterns shown; auto: those that the number of photos is of."""
    period: Annotated[str, Option("PX")] = "16px"
    """Period of the finest cosines."""
    shifts: Annotated[int, Option("N")] = 8
    """Shifts of each cosine."""
    mirror_x: bool = False
    """The camera delivers mirror images: flip them left to right."""


def reads(request: Request) -> list[Path]:
    """The calibration, and the photos."""
    return [request.result, *files_of(_folder(request))]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The cloud. Raises: InputError for what is out of place; RefusedError for an empty cloud."""
    from calibrant.data.result_file import read_result
    from calibrant.data.verdicts import refuse_if_failed
    from calibrant.detection.structured_light.boards import check_size
    from calibrant.detection.structured_light.decode import decode
    from calibrant.perceive.scan.points import scan
    from calibrant.perceive.stereo.eyes import eyes_of

    if request.cloud is not None and request.cloud.suffix.lower() != ".ply":
        raise InputError(f"--cloud {request.cloud}: it is written as .ply; give such a name")
    eyes = eyes_of(_with_projector(read_result(request.result), request.result), ("camera", "projector"))
    folder = _folder(request)
    sequence = _sequence(request, eyes.cameras[1].image_size, len(files_of(folder)))
    with listener.status("Decoding …"):
        capture = read_captured(folder.name, folder, sequence, mirror_x=request.mirror_x)
        _check_picture(capture, eyes)
        decoded = decode(capture)
        check_size(capture, decoded)
        found = scan(decoded, eyes)
    result = _result(request, found, eyes, sequence.code)
    refuse_if_failed(result)
    page = partial(_page, found, capture, result)
    return Outcome(result=result, documents=_documents(request, found, capture), page=page)


def _folder(request: Request) -> Path:
    folders = capture_folders([str(request.capture)])
    if len(folders) != 1:
        raise InputError(f"{request.capture} holds {len(folders)} captures; a scan is of one: name its folder")
    return folders[0]


def _with_projector(result: CalibrationResult, path: Path) -> CalibrationResult:
    if not {"camera", "projector"} <= set(result.cameras):
        raise InputError(
            f"{path} is a {result.kind} result of {', '.join(result.cameras) or 'no camera'}; a scan needs that of "
            "calibrant projector calibrate"
        )
    return result


def _sequence(request: Request, size: tuple[int, int], count: int) -> PatternSequence:
    """The patterns that were shown. Raises: InputError for a count that is of none."""
    if request.code != AUTO:
        return sequence_of(size, request.code, request.period, request.shifts)
    tried = {code: sequence_of(size, code, request.period, request.shifts) for code in CODES}
    for sequence in tried.values():
        if len(sequence.patterns) == count:
            return sequence
    near = min(tried.values(), key=lambda s: abs(len(s.patterns) - count))
    if abs(len(near.patterns) - count) <= 2:
        return near  # one is missing or doubled: the pictures say which
    counts = ", ".join(f"{len(s.patterns)} ({code})" for code, s in tried.items())
    width, height = size
    raise InputError(
        f"{request.capture}: {count} pictures, and the patterns for {width}x{height} px are {counts}; another --period "
        "or --shifts, or a projector of another size?"
    )


def _check_picture(capture: Capture, eyes: Eyes) -> None:
    height, width = capture.white.shape
    if (width, height) != eyes.cameras[0].image_size:
        w, h = eyes.cameras[0].image_size
        raise InputError(f"{capture.name} has pictures of {width}x{height} px, the camera was calibrated at {w}x{h} px")


def _result(request: Request, found: Scan, eyes: Eyes, code: str) -> CalibrationResult:
    from calibrant.data import CalibrationResult, Measured, verdict_of
    from calibrant.data.verdicts import stamp

    z = found.points[:, 2]
    width, height = eyes.cameras[0].image_size
    checks = (_share_check(found, width * height), _across_check(found), _certainty_check(found, eyes))
    figures = {
        "points": Measured(float(len(z))),
        "nearest": Measured(float(np.quantile(z, 0.01)), unit="m"),
        "median_depth": Measured(float(np.median(z)), unit="m"),
        "farthest": Measured(float(np.quantile(z, 0.99)), unit="m"),
        "sigma_z": Measured(float(np.median(found.sigma_z)), unit="m"),
        "sigma_pixels": Measured(float(np.median(found.by_pixels)), unit="m"),
        "sigma_calibration": Measured(float(np.median(found.by_calibration)), unit="m"),
        "across": Measured(found.across),
    }
    options = {"code": code, **({"mirror_x": True} if request.mirror_x else {})}
    inputs = session.file_records(reads(request))
    return stamp(CalibrationResult("scan", verdict_of(checks), checks, figures=figures, options=options, inputs=inputs))


def _share_check(found: Scan, pixels: int) -> Check:
    from calibrant.data import Check

    n = len(found.points)
    text = f"{n} points of {found.decoded} decoded pixels, {n / pixels:.0%} of the picture"
    if n >= FEW * pixels:
        return Check("scanned", "ok", text, n / pixels)
    return Check("scanned", "warn", f"{text}: is the scene in the projector's light, and bright enough?", n / pixels)


def _across_check(found: Scan) -> Check:
    """Whether camera and projector are as they were calibrated: each point has one coordinate to spare."""
    from calibrant.data import Check

    text = f"pixels are off from the epipolar lines by {found.across:.2g} times their sigma (RMS; 1 by noise alone)"
    if found.across <= MOST_ACROSS:
        return Check("epipolar", "ok", text, found.across)
    cure = "camera or projector moved, or was focused, since they were calibrated; or something moved in the capture"
    if found.across > NO_SIGMA:
        cure = f"no depth is known as its sigma says: {cure}; or one of them mirrors its picture (--mirror-x)"
        return Check("epipolar", "fail", f"{text}: {cure}", found.across)
    return Check("epipolar", "warn", f"{text}: {cure}", found.across)


def _certainty_check(found: Scan, eyes: Eyes) -> Check:
    from calibrant.data import Check

    a, b = (1e3 * float(np.median(part)) for part in (found.by_pixels, found.by_calibration))
    z = float(np.median(found.points[:, 2]))
    text = f"sigma of a depth, median at {z:.3g} m: {a:.2g} mm by the pixels, {b:.2g} mm by the calibration"
    if not np.any(eyes.covariance):
        return Check("certainty", "warn", f"{text}: it states no uncertainty, so that its part is missing", b)
    return Check("certainty", "ok", text, b)


def _documents(request: Request, found: Scan, capture: Capture) -> Iterator[Document]:
    from calibrant.formats.clouds import ply_bytes

    if request.cloud is not None:
        yield Document(request.cloud, lambda: ply_bytes(found.cloud(capture.white)))
    if request.picture is not None:
        yield Document(request.picture, partial(_drawn, found, capture, request.picture))


def _drawn(found: Scan, capture: Capture, path: Path) -> bytes:
    from calibrant.perceive.scan.points import coloured_depth

    return encoded(coloured_depth(found, capture.white), path)


def _page(found: Scan, capture: Capture, result: CalibrationResult) -> str:
    from calibrant.perceive.scan.points import coloured_depth
    from calibrant.reports.html import report_page
    from calibrant.reports.parts.pictures import picture_block

    caption = (
        "The camera's picture with the depth z of every point. Depths beyond the scale have the colour of its end."
    )
    return report_page(result, first=[picture_block("Depth in colours", coloured_depth(found, capture.white), caption)])
