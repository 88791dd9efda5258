"""Find where a target is, from photos by a calibrated camera; draw its axes over the photo, of both solutions where two
fit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.inputs.picture_names import picture_names
from calibrant.tasks.inputs.sources import Source
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.images import PhotoOptions, PointsOptions, SearchOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.words import pixels
from calibrant.tasks.outcome import Document, Outcome
from calibrant.tasks.writing import check_spared

if TYPE_CHECKING:
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult, Observations, View
    from calibrant.tasks.options.depth_cameras import DepthRigOptions

EXAMPLE = 'cb.pose("photo.png", camera="camera.json", target="chessboard:9x6:25mm")'

AXES = ((60, 60, 230), (60, 200, 60), (230, 120, 60))
"""Colours of x, y, z in BGR: red, green and blue, as axes are drawn everywhere."""
SECOND_SHADE = 0.55
POINT = (60, 220, 240)
SEGMENTS = 24
"""Pieces an axis is drawn in, so that it bends as the lens bends it."""
FRACTION_BITS = 4


@dataclass(frozen=True, kw_only=True)
class Request:
    """Find where a target is: T_camera_target with its uncertainty in millimetres and degrees.

    calibrant pose photo.png --camera camera.json --target chessboard:9x6:25mm --overlay seen.png
    calibrant pose photo.png --depth depth.png --camera camera.json --target chessboard:9x6:25mm

    Both poses are given where the photo cannot tell them apart. The camera's own uncertainty counts, where its file
    has it.
    """

    photos: PhotoOptions = PhotoOptions()
    camera: Annotated[Path | None, Option("FILE", "-c")] = None
    """The camera that took them (any format)."""
    points: PointsOptions = PointsOptions()
    sigma_px: Annotated[str | None, Option("PX")] = None
    """Noise of a point per axis, e.g. 0.1px; else the detector's, or that of the residuals."""
    confidence: Annotated[float, Option("P")] = 0.99
    """From which probability two solutions are told apart."""
    depth: Annotated[tuple[str, ...], Option("FILES")] = ()
    """Depth of each photo, in the same order: it narrows the distance, and tells two poses apart."""
    depth_camera: Annotated[str | None, Option("NAME")] = None
    """The depth camera in --camera's file, where depth has a grid of its own."""
    baseline: Annotated[str, Option("LENGTH")] = "50mm"
    """Of the depth camera: D435 50mm, D455 95mm."""
    sigma_scale: Annotated[str, Option("PERCENT")] = "2%"
    """1 sigma of a factor that all depths share: as makers state it; verify depth says it better."""
    search: SearchOptions = SearchOptions()
    overlay: Annotated[Path | None, Option("FILE.png", output="either")] = None
    """Draw the target's axes over the photo; of several photos, into this folder."""


def reads(request: Request) -> list[Path]:
    """The photos or the file of points, and the camera's file."""
    source = _pose_source(request, SILENT)
    return [*source.inputs(source.files()), *_depth_files(request), _camera_file(request)]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The poses of the target. Raises: InputError, RefusedError as the parts do."""
    camera = _camera_file(request)
    noise = pixels(request.sigma_px, option="--sigma-px")
    source = _pose_source(request, listener)
    files = source.files()
    depths = _depth_files(request)
    inputs = [*source.inputs(files), *depths, camera]
    found = source.read(files)
    pictures = _pictures(found, request.overlay, inputs)
    session.load_solver(listener)

    from calibrant.calibrate.pose.estimate import estimate_poses
    from calibrant.data.verdicts import refuse_if_failed
    from calibrant.formats.cameras.read import read_camera

    size = next(iter(found.image_sizes.values()))
    known = (
        read_camera(camera, image_size=size) if request.depth_camera is None else _rig_options(request).rig(size).colour
    )
    if depths and len(depths) != len(files):
        raise InputError(f"{len(files)} photos and {len(depths)} depth pictures; expected one for each, in their order")
    with listener.status("Finding poses …"):
        result = estimate_poses(known, found, sigma_px=noise, confidence=request.confidence)
        if depths:
            result = _with_depth(request, result, dict(zip(map(str, files), depths)))
    options = {**result.options, **({"mirror_x": True} if request.search.mirror_x else {})}
    result = session.with_misses(replace(result, options=options, inputs=session.file_records(inputs)))
    refuse_if_failed(result)
    return Outcome(result=result, documents=_overlays(result, pictures, mirror_x=request.search.mirror_x))


def _camera_file(request: Request) -> Path:
    if request.camera is None:
        raise InputError(
            "a pose needs the camera that took the photo: --camera camera.json (calibrant intrinsics --out)"
        )
    return request.camera


def _rig_options(request: Request) -> DepthRigOptions:
    from calibrant.tasks.options.depth_cameras import DepthRigOptions

    return DepthRigOptions(
        camera=request.camera,
        depth_camera=request.depth_camera,
        baseline=request.baseline,
        sigma_scale=request.sigma_scale,
    )


def _depth_files(request: Request) -> list[Path]:
    """The depth pictures. Raises: InputError for one that is not there."""
    if not request.depth:
        return []
    from calibrant.detection.images.depth_files import depth_files

    return depth_files(request.depth)


def _with_depth(request: Request, result: CalibrationResult, depths: dict[str, Path]) -> CalibrationResult:
    """The poses with the depths of their photos. Args: depths by the photo's file."""
    from calibrant.detection.images.depth_files import read_depth
    from calibrant.perceive.board_depth.poses import with_depth

    if result.observations is None:
        raise InputError("--depth goes with photos")
    views = {v.id: v for v in result.observations.views}
    missing = next((v.id for v in views.values() if v.file not in depths), None)
    if missing is not None:
        raise InputError(f"--depth goes with photos; these points name none ({missing}): leave it out")
    options = _rig_options(request)
    rig = options.rig(next(iter(result.observations.image_sizes.values())))
    pictures = {name: read_depth(depths[str(v.file)]) for name, v in views.items()}
    asked = {"baseline": request.baseline, "sigma_scale": request.sigma_scale, "depth_camera": request.depth_camera}
    found = with_depth(result, pictures, rig, noise=options.noise(rig))
    return replace(found, options={**found.options, **{k: v for k, v in asked.items() if v is not None}})


def _pose_source(request: Request, listener: Listener) -> Source:
    return Source.of(request.photos, request.search, listener, points=request.points)


def _pictures(found: Observations, overlay: Path | None, inputs: list[Path]) -> dict[str, Path]:
    """The file of each view's picture by the view's id: the one given, or files in the folder given.

    Raises: InputError when a picture cannot be written there, is an input, or the points come without photos.
    """
    if overlay is None:
        return {}
    if any(v.file is None for v in found.views):
        raise InputError("--overlay draws over the photos; these observations name none: leave it out")
    if len(found.views) == 1 and not overlay.is_dir():
        if not overlay.suffix:
            raise InputError(f"--overlay {overlay}: expected the name of a picture, such as seen.png")
        check_spared([overlay], inputs)
        return {found.views[0].id: overlay}
    if overlay.exists() and not overlay.is_dir():
        raise InputError(f"--overlay {overlay} is a file; {len(found.views)} photos need a folder")
    if not overlay.parent.is_dir():
        raise InputError(f"--overlay {overlay}: there is no folder {overlay.parent}; make it first")
    files = {name: overlay / picture for name, picture in picture_names(v.id for v in found.views).items()}
    check_spared(files.values(), inputs)
    return files


def _overlays(result: CalibrationResult, files: dict[str, Path], *, mirror_x: bool) -> Iterator[Document]:
    """A picture of each view. Args: files by the view's id, as `_pictures` gives them."""
    if not files or result.observations is None:
        return
    for view in result.observations.views:
        yield Document(files[view.id], partial(_overlay, result, view, files[view.id].suffix, mirror_x=mirror_x))


def _overlay(result: CalibrationResult, view: View, suffix: str, *, mirror_x: bool) -> bytes:
    from calibrant.detection.images.images import load_grey
    from calibrant.opencv import cv2

    grey = load_grey(view.file or view.id)
    canvas = np.repeat((grey[:, ::-1] if mirror_x else grey)[..., np.newaxis], 3, axis=2)
    return bytes(cv2.imencode(suffix, drawn(canvas, result, view))[1])


def drawn(canvas: NDArray[np.uint8], result: CalibrationResult, view: View) -> NDArray[np.uint8]:
    """A picture (h, w, 3) BGR with a view's points and the axes of every pose that fits it."""
    from calibrant.calibrate.pose.estimate import SECOND
    from calibrant.opencv import cv2

    out = np.ascontiguousarray(canvas)
    unit = max(out.shape[1] / 1000, 0.6)
    for at in view.uv:
        radius = round(3 * unit * 2**FRACTION_BITS)
        cv2.circle(out, _fixed(at), radius, POINT, max(1, round(unit)), cv2.LINE_AA, FRACTION_BITS)
    length = 0.4 * float(np.ptp(view.points, axis=0).max())
    names = [name + ending for name in ("target", f"target@{view.id}") for ending in (SECOND, "")]
    for t in sorted((t for t in result.transforms if t.child in names), key=lambda t: names.index(t.child)):
        second = t.child.endswith(SECOND)
        for axis, colour in enumerate(AXES):
            shade = tuple(int(c * (SECOND_SHADE if second else 1)) for c in colour)
            line = axis_pixels(next(iter(result.cameras.values())), t.matrix, axis, length)
            if line is not None:
                width = max(1, round((1 if second else 3) * unit))
                points = np.rint(line * 2**FRACTION_BITS).astype(np.int32)
                cv2.polylines(out, [points], False, shade, width, cv2.LINE_AA, FRACTION_BITS)
                _label(out, "xyz"[axis] + ("'" if second else ""), line[-1], shade, unit)
    return out


def axis_pixels(camera: Camera, T_camera_target: Array, axis: int, length: float) -> Array | None:
    """Pixels (n, 2) of an axis of the target; None where the camera does not see all of it."""
    from calibrant.geometry import se3

    points = np.zeros((SEGMENTS + 1, 3))
    points[:, axis] = np.linspace(0, length, SEGMENTS + 1)
    uv = camera.project(se3.apply(T_camera_target, points))
    limit = 10 * max(camera.image_size)
    return uv if np.all(np.isfinite(uv)) and np.abs(uv).max() < limit else None


def _label(canvas: NDArray, text: str, at: Array, colour: tuple[int, ...], unit: float) -> None:
    from calibrant.opencv import cv2

    corner = (int(at[0] + 5 * unit), int(at[1] - 5 * unit))
    for shade, width in (((0, 0, 0), 3), (colour, 1)):
        cv2.putText(
            canvas, text, corner, cv2.FONT_HERSHEY_SIMPLEX, 0.6 * unit, shade, max(1, round(width * unit)), cv2.LINE_AA
        )


def _fixed(at: Array) -> tuple[int, int]:
    return round(float(at[0]) * 2**FRACTION_BITS), round(float(at[1]) * 2**FRACTION_BITS)
