"""Own points in 3D-EasyCalib's form: a YAML file beside each image, `corners` and `obj` as matrices of OpenCV.

corners (n rows of 2f) are pixels x, y; obj (n rows of 3f, or of 2f for a flat target) the same points on the target,
X, Y, Z, in millimetres unless the target's spec says otherwise (manual, section 5.6 and figure 5.6). Pixel (0, 0) is
the centre of the top-left pixel, as OpenCV's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.data import DEFAULT_CAMERA, Missed, Observations, View
from calibrant.errors import InputError
from calibrant.formats.documents.opencv_storage import read_yaml
from calibrant.reading.files import DOCUMENT, read_text
from calibrant.targets.point_folder import PointFolder

ENDINGS = (".yml", ".yaml")
FEWEST_POINTS = 4
"""A pose needs four points: three have up to four poses."""
ON_A_LINE = 1e-5
"""Width over length below which points lie on a line: a hundred-thousandth of a target is below any measurement."""
_EXPECTED = "expected two matrices of OpenCV, corners (n rows of 2f, pixels) and obj (n rows of 3f or 2f)"


@dataclass(frozen=True, eq=False)
class OwnPoints:
    """What one file holds: uv (n, 2) pixels and points (n, 3) metres, target frame."""

    uv: Array
    points: Array


def read_own_points(path: str | Path, *, metres: float = 1e-3) -> OwnPoints:
    """Points of one file. Args: metres, what its lengths are multiplied by.

    Raises: InputError naming the file and what is wrong: unknown or missing keys, no matrices, sizes that differ, too
    few points, values that are not finite, a point given twice, points on a line.
    """
    path = Path(path)
    text = read_text(path, most=DOCUMENT, what="points file", expected="YAML")
    data = read_yaml(text, str(path))
    try:
        return _own_points(data, metres)
    except InputError as error:
        raise InputError(f"points file {path}: {error}") from None


def own_observations(
    images: Sequence[str | Path], target: PointFolder, *, image_size: tuple[int, int], camera: str = DEFAULT_CAMERA
) -> Observations:
    """Observations of images from the files beside them: photo.png takes photo.yml (or photo.yaml) of the folder.

    Points with the same place on the target have the same label in all images; an image without a file is missed.
    Raises: InputError when no image has a file, when two images are called the same, for points outside the image, and
    as `read_own_points`.
    """
    names = [Path(image).name for image in images]
    stems = [Path(name).stem for name in names]
    for name, stem in zip(names, stems):
        if stems.count(stem) > 1:
            raise InputError(f"two images would take their points from {stem}.yml, one is {name}; rename one of them")
    labels: dict[tuple[float, ...], int] = {}
    views, missed = [], []
    for image, name, stem in zip(images, names, stems):
        file = file_of(target, stem)
        if file is None:
            reason = f"there is no {stem}.yml in {target.folder}"
            missed.append(Missed(name, reason, camera, str(image)))
            continue
        own = read_own_points(file, metres=target.metres)
        _refuse_outside(own.uv, image_size, file)
        ids = [labels.setdefault(tuple(p), len(labels)) for p in own.points.tolist()]
        views.append(View(name, own.points, own.uv, np.array(ids), camera, file=str(image)))
    if not views:
        raise InputError(
            f"no image has its points beside it: {missed[0].reason if missed else 'no images'}; expected a file for "
            f"each image, {stems[0] if stems else 'IMAGE'}.yml, with corners and obj"
        )
    notes = (f"the points of {target.spec} are read as {target.unit}",)
    return Observations(tuple(views), {camera: image_size}, target.spec, tuple(missed), notes)


def file_of(target: PointFolder, stem: str) -> Path | None:
    """The file of an image of that name without its ending; None when there is none."""
    for ending in ENDINGS:
        path = Path(target.folder) / f"{stem}{ending}"
        if path.is_file():
            return path
    return None


def _own_points(data: Any, metres: float) -> OwnPoints:
    if not isinstance(data, Mapping):
        raise InputError(f"it holds no keys and values; {_EXPECTED}")
    unknown = [str(key) for key in data if key not in ("corners", "obj")]
    if unknown:
        raise InputError(f"unknown key {unknown[0]!r}; {_EXPECTED}")
    missing = [key for key in ("corners", "obj") if key not in data]
    if missing:
        raise InputError(f"there is no {' and no '.join(missing)}; {_EXPECTED}")
    uv, points = _rows(data["corners"], "corners", (2,)), _rows(data["obj"], "obj", (3, 2))
    if len(uv) != len(points):
        raise InputError(f"corners has {len(uv)} points and obj has {len(points)}; each corner needs its point")
    if len(uv) < FEWEST_POINTS:
        raise InputError(f"{len(uv)} points; expected at least {FEWEST_POINTS}")
    if points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points))])
    _refuse_bad(points, "obj", "on the target")
    _refuse_bad(uv, "corners", "in the image")
    return OwnPoints(uv, metres * points)


def _rows(value: Any, key: str, widths: tuple[int, ...]) -> Array:
    """Points (n, width) of a matrix of n rows, or of n columns, with one channel a coordinate or one column each."""
    wanted = " or ".join(f"{w}f" for w in widths)
    if not isinstance(value, np.ndarray):
        raise InputError(f"{key} is no matrix of OpenCV (`{key}: !!opencv-matrix`); {_EXPECTED}")
    array = value.reshape(-1, value.shape[2]) if value.ndim == 3 and 1 in value.shape[:2] else value
    if array.ndim != 2 or array.shape[1] not in widths:
        raise InputError(f"{key} is a matrix of shape {value.shape}; expected n rows of {wanted}")
    out = np.asarray(array, dtype=np.float64)
    bad = np.flatnonzero(~np.isfinite(out).all(axis=1))
    if len(bad):
        raise InputError(f"{key}: point {bad[0] + 1} is {out[bad[0]].tolist()}; expected finite numbers")
    return out


def _refuse_bad(points: Array, key: str, where: str) -> None:
    values, counts = np.unique(points, axis=0, return_counts=True)
    if counts.max() > 1:
        raise InputError(
            f"{key} has the point {values[np.argmax(counts)].tolist()} {counts.max()} times; expected once"
        )
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[1] <= ON_A_LINE * spread[0]:
        raise InputError(
            f"all {len(points)} points of {key} lie on a line {where}, which determines no pose; expected points "
            "across a plane, or in space"
        )


def _refuse_outside(uv: Array, image_size: tuple[int, int], file: Path) -> None:
    width, height = image_size
    outside = np.flatnonzero(np.any((uv < -0.5) | (uv > np.array([width, height]) - 0.5), axis=1))
    if len(outside):
        u, v = uv[outside[0]]
        raise InputError(
            f"points file {file}: corner {outside[0] + 1} is at ({u:g}, {v:g}), outside its image of {width}x{height} "
            "px; expected x, y in pixels of this image"
        )
