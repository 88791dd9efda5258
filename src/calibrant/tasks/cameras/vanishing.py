"""What `calibrant vanishing` does: read, find the edges and the rotation, draw them by direction."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibrant.cli import session
from calibrant.errors import InputError

if TYPE_CHECKING:
    from calibrant.calibrate.vanishing.manhattan import Manhattan
    from calibrant.data import CalibrationResult

COLOURS = ((60, 60, 230), (60, 200, 60), (240, 130, 50))
"""Of x, y, z in BGR: red, green and blue, as axes are drawn everywhere."""
OTHER = (150, 150, 150)
FRACTION_BITS = 4


def solved(image: Path, camera: Path | None, focal: str) -> tuple[Manhattan, CalibrationResult]:
    """The rotation of an image and its result. Raises: InputError, RefusedError as the parts do."""
    from calibrant.calibrate.vanishing.manhattan import default_camera, manhattan_rotation
    from calibrant.calibrate.vanishing.result import vanishing_result
    from calibrant.detection.images.images import load_grey
    from calibrant.detection.line_segments import find_segments
    from calibrant.formats.cameras.read import read_camera

    if focal not in ("known", "unknown"):
        raise InputError(f"--focal is known (the camera's) or unknown (found from the picture), got {focal!r}")
    grey = load_grey(image)
    height, width = grey.shape
    if camera is None:
        known, focal = default_camera((width, height)), "unknown"
    else:
        known = read_camera(camera, image_size=(width, height))
    found = manhattan_rotation(find_segments(grey), known, focal="unknown" if focal == "unknown" else "known")
    files = [image, *([camera] if camera is not None else [])]
    return found, replace(vanishing_result(found), inputs=session.file_records(files))


def check_picture(overlay: Path) -> None:
    """Raises: InputError for a name that no picture can have."""
    import cv2

    if not overlay.suffix or not cv2.haveImageWriter(overlay.name):
        raise InputError(f"--overlay {overlay}: expected the name of a picture, such as lines.png")


def draw(image: Path, found: Manhattan, overlay: Path) -> None:
    """Write the picture with the edges in the colours of their directions. Raises: InputError."""
    import cv2

    from calibrant.detection.images.images import load_grey

    canvas = drawn(load_grey(image), found)
    session.write_bytes(overlay, bytes(cv2.imencode(overlay.suffix, canvas)[1]))


def drawn(grey: NDArray[np.uint8], found: Manhattan) -> NDArray[np.uint8]:
    """A picture (h, w, 3) BGR: edges as they bend, x red, y green, z blue, others grey; crosses where they meet."""
    import cv2

    from calibrant.calibrate.vanishing.manhattan import vanishing_point

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
