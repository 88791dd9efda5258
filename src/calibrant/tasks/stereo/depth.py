"""Depth of what two pictures show: a cloud with colours, a map, and how certain every depth is."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.outcome import Document, Outcome
from calibrant.tasks.pictures import encoded
from calibrant.tasks.stereo.rectify import LARGE_ROW_PX, RectifiedOptions

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult, Check
    from calibrant.perceive.stereo.depth import DepthMap

EXAMPLE = 'cb.depth("stereo.json", left="left.png", right="right.png", cloud="cloud.ply")'
FEW = 0.1
"""Part of the picture that is matched, below which it says little of the scene."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Measure the depth of what two pictures show, taken at one moment by calibrated cameras.

    calibrant depth stereo.json --left left.png --right right.png --cloud cloud.ply --picture depth.png

    The pictures are rectified and matched in both directions. The cloud (PLY) is in the left camera's frame, in metres,
    with colours, and for every point sigma_z, its parts by the match and by the calibration, and a confidence.
    """

    result: Annotated[Path, Option("RESULT", positional=True)]
    """The calibration of both cameras: a result file, or stereo.yml as OpenCV has it."""
    left: Annotated[Path, Option("IMAGE")]
    """The left (first, upper) camera's picture."""
    right: Annotated[Path, Option("IMAGE")]
    """The right one's, taken at the same moment."""
    cloud: Annotated[Path | None, Option("FILE.ply", output="file")] = None
    """Write the points here."""
    maps: Annotated[Path | None, Option("FILE.npz", output="file")] = None
    """Write z, its sigma, disparity and confidence of the left rectified picture here, as NumPy's archive."""
    picture: Annotated[Path | None, Option("FILE.png", output="file")] = None
    """Draw depth and sigma in colours, each with its scale in mm; --report shows the same."""
    near: Annotated[str | None, Option("LENGTH")] = None
    """The nearest distance looked for: 0.4m; without it features of the pictures tell."""
    far: Annotated[str | None, Option("LENGTH")] = None
    """The farthest."""
    confidence: Annotated[float, Option("0..1")] = 0.25
    """Leave out points that are less sure."""
    rectified: RectifiedOptions = RectifiedOptions()


def reads(request: Request) -> list[Path]:
    """The result file and both pictures."""
    return [request.result, request.left, request.right]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The depth map. Raises: InputError for unusable arguments; RefusedError for exchanged sides, an empty cloud."""
    from calibrant.data.verdicts import refuse_if_failed
    from calibrant.detection.images.images import load_image
    from calibrant.formats.cameras.read import read_pair
    from calibrant.perceive.stereo.depth import depth_map
    from calibrant.targets.lengths import parse_length

    _check(request)
    near, far = (
        None if text is None else parse_length(text, what=name)
        for name, text in (("--near", request.near), ("--far", request.far))
    )
    pair = request.rectified.pair(read_pair(request.result))
    images = []
    for side, file in zip(("left", "right"), (request.left, request.right)):
        images.append(load_image(file))
        camera = pair.eyes.cameras[("left", "right").index(side)]
        height, width = images[-1].shape[:2]
        if (width, height) != camera.image_size:
            w, h = camera.image_size
            raise InputError(f"{file} is {width}x{height} px, the {side} camera is for images of {w}x{h} px")
    with listener.status("Matching …"):
        found = depth_map(pair, images, near=near, far=far, least_confidence=request.confidence)
    cloud = found.cloud(images[0])  # refused where it is empty, asked for or not
    result = _result(request, found)
    refuse_if_failed(result)

    def documents() -> Iterator[Document]:
        from calibrant.formats.clouds import ply_bytes

        if request.cloud is not None:
            yield Document(request.cloud, partial(ply_bytes, cloud))
        if request.maps is not None:
            yield Document(request.maps, partial(_map_bytes, found))
        if request.picture is not None:
            yield Document(request.picture, partial(_drawn, found, request.picture))

    return Outcome(result=result, documents=documents(), page=partial(_page, found, result))


def _check(request: Request) -> None:
    """Raises: InputError for names that say another format, one picture on both sides, a confidence out of range."""
    for option, path, ending in (("--cloud", request.cloud, ".ply"), ("--maps", request.maps, ".npz")):
        if path is not None and path.suffix.lower() != ending:
            raise InputError(f"{option} {path}: it is written as {ending}; give such a name")
    if request.left.resolve() == request.right.resolve():
        raise InputError(f"{request.left} is given as the left and as the right picture")
    if not 0 <= request.confidence <= 1:
        raise InputError(f"--confidence is 0 (all) to 1 (none), got {request.confidence:g}")


def _result(request: Request, found: DepthMap) -> CalibrationResult:
    from calibrant.data import CalibrationResult, Measured, verdict_of
    from calibrant.data.verdicts import stamp

    known = found.known
    z = found.points[..., 2][known]
    checks = (_matched_check(found), _rows_check(found), _certainty_check(found))
    figures = {
        "points": Measured(float(known.sum())),
        "nearest": Measured(float(np.quantile(z, 0.01)), unit="m"),
        "median_depth": Measured(float(np.median(z)), unit="m"),
        "farthest": Measured(float(np.quantile(z, 0.99)), unit="m"),
        "sigma_z": Measured(float(np.median(found.sigma_z[known])), unit="m"),
        "sigma_matches": Measured(float(np.median(found.by_matches[known])), unit="m"),
        "sigma_calibration": Measured(float(np.median(found.by_calibration[known])), unit="m"),
        "sigma_disparity": Measured(float(np.median(found.disparity.sigma[known])), unit="px"),
    }
    given = {"near": request.near, "far": request.far, "confidence": request.confidence}
    return stamp(
        CalibrationResult(
            "depth",
            verdict_of(checks),
            checks,
            figures=figures,
            options={**request.rectified.words, **{n: v for n, v in given.items() if v is not None}},
            inputs=session.file_records(reads(request)),
        )
    )


def _matched_check(found: DepthMap) -> Check:
    from calibrant.data import Check

    there = found.pair.maps[0].valid
    share = float(found.known.sum()) / max(int(there.sum()), 1)
    text = f"{int(found.known.sum())} of {int(there.sum())} pixels have a depth ({100 * share:.0f} %)"
    if share >= FEW:
        return Check("matched", "ok", text, share)
    return Check("matched", "warn", f"{text}: is there texture, and are the distances within --near and --far?", share)


def _rows_check(found: DepthMap) -> Check:
    """Whether the pair is still as it was calibrated: features tell, whatever the pictures show."""
    from calibrant.data import Check

    if not found.sparse.enough:
        return Check("rows", "ok", "too few features to tell whether the cameras stand as they were calibrated")
    off = np.median(np.abs(found.sparse.row_errors[found.sparse.on_rows])) / 0.6745
    text = f"{int(found.sparse.on_rows.sum())} features of both pictures share a row to {off:.2g} px (1 sigma)"
    if off <= LARGE_ROW_PX:
        return Check("rows", "ok", text, float(off))
    return Check(
        "rows", "warn", f"{text}: did a camera move since it was calibrated, or the scene between?", float(off)
    )


def _certainty_check(found: DepthMap) -> Check:
    from calibrant.data import Check

    known, eyes = found.known, found.pair.eyes
    a, b = (1e3 * float(np.median(part[known])) for part in (found.by_matches, found.by_calibration))
    z = float(np.median(found.points[..., 2][known]))
    text = f"sigma of a depth, median at {z:.3g} m: {a:.2g} mm by the match, {b:.2g} mm by the calibration"
    if not np.any(eyes.covariance):
        return Check("certainty", "warn", f"{text}: it states no uncertainty, so that its part is missing", b)
    if not eyes.joint:
        text += "; it holds lenses and places apart, so that its part looks larger than it is"
        return Check("certainty", "warn", text, b)
    return Check("certainty", "ok", text, b)


def _map_bytes(found: DepthMap) -> bytes:
    buffer = io.BytesIO()
    view = found.pair.views[0]
    arrays: dict[str, Any] = {
        "points": found.points.astype(np.float32),
        "sigma_z": found.sigma_z.astype(np.float32),
        "sigma_matches": found.by_matches.astype(np.float32),
        "sigma_calibration": found.by_calibration.astype(np.float32),
        "disparity": found.disparity.d.astype(np.float32),
        "confidence": found.disparity.confidence.astype(np.float32),
        "K": np.array([[view.f, 0, view.cx], [0, view.f, view.cy], [0, 0, 1]]),
        "R_rectified_camera": found.pair.R_rectified_camera[0],
    }
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def _drawn(found: DepthMap, path: Path) -> bytes:
    from calibrant.perceive.stereo.depth import coloured_depth

    return encoded(coloured_depth(found), path)


def _page(found: DepthMap, result: CalibrationResult) -> str:
    from calibrant.perceive.stereo.depth import coloured_depth
    from calibrant.reports.html import report_page
    from calibrant.reports.parts.pictures import picture_block

    caption = (
        "The left picture, rectified: z (above) and its sigma (below). Black: no depth there. Lengths beyond the scale "
        "have the colour of its end."
    )
    return report_page(result, first=[picture_block("Depth in colours", coloured_depth(found), caption)])
