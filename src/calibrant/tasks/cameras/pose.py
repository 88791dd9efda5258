"""Pictures that `calibrant pose` draws: the target's axes and points over the photo, both solutions where two fit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibrant.cli import session
from calibrant.errors import InputError

if TYPE_CHECKING:
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult, Observations, View

Array = NDArray[np.float64]

AXES = ((60, 60, 230), (60, 200, 60), (230, 120, 60))
"""Colours of x, y, z in BGR: red, green and blue, as axes are drawn everywhere."""
SECOND_SHADE = 0.55
POINT = (60, 220, 240)
SEGMENTS = 24
"""Pieces an axis is drawn in, so that it bends as the lens bends it."""
FRACTION_BITS = 4


def pictures(found: Observations, overlay: Path | None, inputs: Sequence[Path], *, force: bool) -> dict[str, Path]:
    """The file of each view's picture by the view's id: the one given, or files in the folder given.

    Raises: InputError when a picture cannot be written there, is an input, or the points come without photos.
    """
    if overlay is None:
        return {}
    if any(v.file is None for v in found.views):
        raise InputError("--overlay draws over the photos; these observations name none: leave it out")
    if len(found.views) == 1 and not overlay.is_dir():
        session.check_writable(overlay, force=force)
        if not overlay.suffix:
            raise InputError(f"--overlay {overlay}: expected the name of a picture, such as seen.png")
        session.Outputs(overlay).spare(inputs)
        return {found.views[0].id: overlay}
    if overlay.exists() and not overlay.is_dir():
        raise InputError(f"--overlay {overlay} is a file; {len(found.views)} photos need a folder")
    if not overlay.parent.is_dir():
        raise InputError(f"--overlay {overlay}: there is no folder {overlay.parent}; make it first")
    files = {v.id: overlay / (v.id.replace("/", "_") + ".png") for v in found.views}
    for path in files.values():
        if path.exists() and not force:
            raise InputError(f"{path} exists already; give another folder, or --force to replace it")
        session.Outputs(path).spare(inputs)
    return files


def draw(result: CalibrationResult, files: dict[str, Path], *, mirror_x: bool) -> None:
    """Write the pictures. Args: files by the view's id, as `pictures` gives them."""
    if not files or result.observations is None:
        return
    import cv2

    from calibrant.detection.images.images import load_grey

    for view in result.observations.views:
        path = files[view.id]
        path.parent.mkdir(exist_ok=True)
        grey = load_grey(view.file or view.id)
        canvas = np.repeat((grey[:, ::-1] if mirror_x else grey)[..., np.newaxis], 3, axis=2)
        encoded = cv2.imencode(path.suffix or ".png", drawn(canvas, result, view))[1]
        session.write_bytes(path, bytes(encoded))


def drawn(canvas: NDArray[np.uint8], result: CalibrationResult, view: View) -> NDArray[np.uint8]:
    """A picture (h, w, 3) BGR with a view's points and the axes of every pose that fits it."""
    import cv2

    from calibrant.calibrate.pose.estimate import SECOND

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
    import cv2

    corner = (int(at[0] + 5 * unit), int(at[1] - 5 * unit))
    for shade, width in (((0, 0, 0), 3), (colour, 1)):
        cv2.putText(
            canvas, text, corner, cv2.FONT_HERSHEY_SIMPLEX, 0.6 * unit, shade, max(1, round(width * unit)), cv2.LINE_AA
        )


def _fixed(at: Array) -> tuple[int, int]:
    return round(float(at[0]) * 2**FRACTION_BITS), round(float(at[1]) * 2**FRACTION_BITS)
