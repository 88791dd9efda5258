"""Find how a camera is turned against a scene: edges, their directions, the rotation; the edges drawn by direction."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.outcome import Document, Outcome

if TYPE_CHECKING:
    from calibrant.calibrate.vanishing.manhattan import Manhattan

EXAMPLE = 'cb.vanishing("street.jpg", camera="camera.json")'

COLOURS = ((60, 60, 230), (60, 200, 60), (240, 130, 50))
"""Of x, y, z in BGR: red, green and blue, as axes are drawn everywhere."""
OTHER = (150, 150, 150)
FRACTION_BITS = 4


@dataclass(frozen=True, kw_only=True)
class Request:
    """Find how a camera is turned against a scene of three orthogonal directions, from one photo.

    calibrant vanishing street.jpg --camera camera.json --overlay lines.png

    Prints the rotation camera -> scene (x right, y down, z ahead) with its uncertainty, how many edges follow each
    direction and where they meet, and how far from right angles the directions are. Without a camera the focal length
    is found too.
    """

    image: Annotated[Path, Option("IMAGE", positional=True)]
    """A photo of a building, a room, a machine."""
    camera: Annotated[Path | None, Option("FILE", "-c")] = None
    """The camera (any format); without it: --focal unknown."""
    focal: Annotated[str, Option("known|unknown")] = "known"
    """unknown: find the focal length as well."""
    overlay: Annotated[Path | None, Option("FILE.png", output="file")] = None
    """Draw the edges over the photo, coloured by direction."""


def reads(request: Request) -> list[Path]:
    """The photo, and the camera's file."""
    return [request.image, *([request.camera] if request.camera is not None else [])]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The rotation. Raises: InputError, RefusedError as the parts do."""
    from calibrant.calibrate.vanishing.result import vanishing_result
    from calibrant.data.verdicts import refuse_if_failed

    if request.focal not in ("known", "unknown"):
        raise InputError(f"--focal is known (the camera's) or unknown (found from the picture), got {request.focal!r}")
    if request.overlay is not None:
        _check_picture(request.overlay)
    session.load_solver(listener)
    with listener.status("Looking for edges …"):
        found = _rotation(request)
    result = replace(vanishing_result(found), inputs=session.file_records(reads(request)))
    refuse_if_failed(result)
    overlays = () if request.overlay is None else (Document(request.overlay, partial(_picture, request, found)),)
    return Outcome(result=result, documents=overlays)


def _rotation(request: Request) -> Manhattan:
    from calibrant.calibrate.vanishing.manhattan import default_camera, manhattan_rotation
    from calibrant.detection.images.images import load_grey
    from calibrant.detection.line_segments import find_segments
    from calibrant.formats.cameras.read import read_camera

    grey = load_grey(request.image)
    height, width = grey.shape
    if request.camera is None:
        return manhattan_rotation(find_segments(grey), default_camera((width, height)), focal="unknown")
    known = read_camera(request.camera, image_size=(width, height))
    return manhattan_rotation(find_segments(grey), known, focal="unknown" if request.focal == "unknown" else "known")


def _check_picture(overlay: Path) -> None:
    """Raises: InputError for a name that no picture can have."""
    from calibrant.opencv import cv2

    if not overlay.suffix or not cv2.haveImageWriter(overlay.name):
        raise InputError(f"--overlay {overlay}: expected the name of a picture, such as lines.png")


def _picture(request: Request, found: Manhattan) -> bytes:
    """The picture with the edges in the colours of their directions."""
    from calibrant.detection.images.images import load_grey
    from calibrant.opencv import cv2

    suffix = request.overlay.suffix if request.overlay is not None else ".png"
    return bytes(cv2.imencode(suffix, drawn(load_grey(request.image), found))[1])


def drawn(grey: NDArray[np.uint8], found: Manhattan) -> NDArray[np.uint8]:
    """A picture (h, w, 3) BGR: edges as they bend, x red, y green, z blue, others grey; crosses where they meet."""
    from calibrant.calibrate.vanishing.manhattan import vanishing_point
    from calibrant.opencv import cv2

    canvas = np.repeat((0.5 * grey + 100).astype(np.uint8)[..., np.newaxis], 3, axis=2)
    unit = max(canvas.shape[1] / 1000, 0.6)
    parts = np.split(found.segments.uv, found.segments.offsets[1:-1])
    for member, uv in sorted(zip(found.member.tolist(), parts), key=lambda pair: pair[0]):
        points = np.rint(uv * 2**FRACTION_BITS).astype(np.int32)
        colour = COLOURS[member] if member >= 0 else OTHER
        cv2.polylines(canvas, [points], False, colour, max(1, round(2 * unit)), cv2.LINE_AA, FRACTION_BITS)
    width, height = found.camera.image_size
    for k, colour in enumerate(COLOURS):
        at = vanishing_point(found.camera, found.R_camera_scene[:, k])
        if at is not None and 0 <= at[0] < width and 0 <= at[1] < height:
            place = (round(float(at[0])), round(float(at[1])))
            cv2.drawMarker(
                canvas, place, colour, cv2.MARKER_CROSS, round(24 * unit), max(1, round(2 * unit)), cv2.LINE_AA
            )
    return canvas
