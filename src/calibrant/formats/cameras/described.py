"""A camera described by keys: OpenCV's FileStorage, ROS's camera_info, Kalibr, RealSense, NeRF, MATLAB, one's own JSON.

A 3x3 matrix, or fx, fy, cx, cy, or Kalibr's list of intrinsics; the terms of the lens by any of their names (`lens`);
the size of the images. What is not used is refused where it could bend the picture, and said otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.cameras.model import REQUIRED
from calibrant.cameras.plane_distortion import TERMS
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import (
    Size,
    matrix_parameters,
    numbers,
    whole_size,
)
from calibrant.formats.cameras.fields import Fields, spelled
from calibrant.formats.cameras.lens import family_of, lens_camera
from calibrant.reading.notes import note_unused

_MATRIX_KEYS = (
    *("cameramatrix", "k", "m1", "k1", "intrinsicmatrix", "intrinsics", "intrinsic", "mtx", "camint", "cameramat"),
    *("kmatrix", "matrix", "cameramatrix1", "cameraintrinsics", "cameraintrinsic", "intrinsicsmatrix", "kmat"),
    *("intrinsicparameters", "cammtx", "cammatrix", "newcameramatrix"),
)
_SECOND_KEYS = ("m2", "k2", "cameramatrix2")
_FOCAL = (("fx", "flx"), ("fy", "fly"), ("cx", "ppx"), ("cy", "ppy"))
"""Focal lengths and principal point; NeRF's and RealSense's names after them."""
_WIDTH_KEYS = ("imagewidth", "width", "w", "imgwidth", "cols")
_HEIGHT_KEYS = ("imageheight", "height", "h", "imgheight", "rows")
_SIZE_KEYS = (
    "imagesize",
    "size",
    "resolution",
    "cameraresolution",
    "imgsize",
    "framesize",
    "imagedimensions",
    "dimensions",
    "dim",
)
_SHAPE_KEYS = ("imgshape", "imageshape", "shape")
"""An array's shape is (rows, columns): height first."""
_WRAPPED = ("distortion", "distortionmodel", "lens", "resolution", "imagesize", "size")
"""Keys whose values are taken apart where they are mappings: what is in them stands beside the camera as well."""
_FAR = 0.25
"""Of the image, from its middle: a lens sits within a tenth; one that is shifted, as a projector's, is so one way."""
_KALIBR_FIRST = {"unified": ("xi",), "double_sphere": ("xi", "alpha"), "extended_unified": ("alpha", "beta")}
"""What stands before fx, fy, cx, cy in Kalibr's list of intrinsics."""


def is_described(data: Mapping[str, Any]) -> bool:
    """Whether the file has focal lengths in any of the ways that are read."""
    return _found(Fields(data)) or len(_wrappers(data)) > 0


def described_cameras(data: Mapping[str, Any], image_size: Size | None, source: str) -> dict[str, Camera]:
    """The camera of the keys, or each of several under their names, with what stands beside them for all of them.

    Raises: InputError as `described_camera`, naming which.
    """
    wrappers = [] if _found(Fields(data)) else _wrappers(data)
    if len(wrappers) < 2:
        return {"camera": described_camera(data, image_size, source)}
    shared = {key: value for key, value in data.items() if key not in wrappers}
    cameras = {}
    for name in wrappers:
        try:
            cameras[str(name)] = described_camera(shared | {name: data[name]}, image_size, f"{source}: {name}")
        except InputError as error:
            raise InputError(f"{name}: {error}") from error
    return cameras


def described_camera(data: Mapping[str, Any], image_size: Size | None, source: str) -> Camera:
    """The camera of the keys. Raises: InputError for several cameras, terms that are not known, a size that is none."""
    fields = Fields(data)
    inside: str | None = None
    if not _found(fields):
        wrappers = _wrappers(data)
        if len(wrappers) > 1:
            raise InputError(f"{len(wrappers)} cameras ({', '.join(map(str, wrappers))}); give a file of one camera")
        if not wrappers:
            listed = ", ".join(map(str, list(data)[:8])) or "none"
            raise InputError(f"no camera matrix (K, camera_matrix, or fx, fy, cx, cy) among the keys: {listed[:200]}")
        inside = wrappers[0]
        fields.without(spelled(inside))
        fields = Fields(data[inside], above=fields)
    for key in _WRAPPED:
        value = fields.peek(key)
        if isinstance(value, Mapping):
            fields.without(key)
            fields.spread(value)
    family = family_of(fields)
    found = _stated_size(fields)
    K, before = _focal(fields, family)
    found = _ordered(fields, found, K, image_size)
    if before:
        fields.spread(before)
    camera = _with_sigma(lens_camera(K, fields, family, found, image_size), fields)
    note_unused(source, fields.unused())
    return camera


def _found(fields: Fields) -> bool:
    if _matrix_keys(fields) or all(any(fields.peek(k) is not None for k in names) for names in _FOCAL):
        return True
    return _kalibr_list(fields) is not None or _pairs(fields) is not None


def _wrappers(data: Mapping[str, Any]) -> list[str]:
    """Keys under which a camera stands."""
    return [key for key, value in data.items() if isinstance(value, Mapping) and _found(Fields(value))]


def _focal(fields: Fields, family: str | None) -> tuple[tuple[float, ...], dict[str, float]]:
    """fx, fy, cx, cy, skew; and, of Kalibr's list, the terms that stand before them."""
    ways: list[tuple[float, ...]] = []
    before: dict[str, float] = {}
    for key in _matrix_keys(fields):
        ways.append(matrix_parameters(np.asarray(fields.get(key), dtype=np.float64).reshape(3, 3)))
    if all(any(fields.peek(k) is not None for k in names) for names in _FOCAL):
        four = [numbers(fields.first(names)[1], names[0]) for names in _FOCAL]  # type: ignore[index]
        for names, values in zip(_FOCAL, four):
            if len(values) != 1:
                raise InputError(f"{names[0]} holds {len(values)} numbers, expected one")
        skew = fields.numbers_named(("skew",)).get("skew", ways[0][4] if ways else 0.0)
        ways.append((*(float(v[0]) for v in four), skew))
    pairs = _pairs(fields)
    if pairs is not None:
        ways.append((*pairs, 0.0))
        fields.get("focallength")
        fields.get("principalpoint")
    listed = _kalibr_list(fields)
    if listed is not None and not ways:
        fields.get("intrinsics")
        first = _KALIBR_FIRST.get(family or "", ())
        if len(listed) != 4 + len(first):
            wanted = ", ".join((*first, "fx", "fy", "cx", "cy"))
            raise InputError(f"intrinsics holds {len(listed)} numbers, expected {wanted} for this model")
        before = {name: float(v) for name, v in zip(first, listed)}
        ways.append((*(float(v) for v in listed[len(first) :]), 0.0))
    for other in ways[1:]:
        if not np.allclose(other, ways[0], rtol=1e-9, atol=1e-9):
            raise InputError(
                f"two camera matrices that differ: fx, fy, cx, cy, skew {_listed(ways[0])} and {_listed(other)}; keep "
                "one"
            )
    return ways[0], before


def _listed(values: tuple[float, ...]) -> str:
    return ", ".join(f"{v:g}" for v in values)


def _matrix_keys(fields: Fields) -> list[str]:
    """Keys of the camera matrix. Raises: InputError when the file holds the matrices of two cameras."""
    found = [key for key in _MATRIX_KEYS if _is_matrix(fields.peek(key))]
    stated = _as_numbers(fields.peek("cameramatrix"))
    if stated is not None and stated.size != 9:
        raise InputError(f"{fields.name('cameramatrix')} has {stated.size} numbers, expected 9")
    second = [key for key in _SECOND_KEYS if _is_matrix(fields.peek(key))]
    if found and second:
        raise InputError(
            f"a stereo file with two camera matrices, {fields.name(found[0])} and {fields.name(second[0])}; give a "
            "file of one camera"
        )
    return found


def _is_matrix(value: Any) -> bool:
    """Nine numbers in a square or, as ROS sends them, in a row."""
    array = _as_numbers(value)
    return array is not None and array.shape in ((3, 3), (9,), (1, 9), (9, 1))


def _as_numbers(value: Any) -> Array | None:
    if not isinstance(value, np.ndarray | list):
        return None
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None


def _kalibr_list(fields: Fields) -> NDArray | None:
    values = _as_numbers(fields.peek("intrinsics"))
    return values if values is not None and values.ndim == 1 and 4 <= len(values) <= 6 else None


def _pairs(fields: Fields) -> tuple[float, ...] | None:
    """focal_length [fx, fy] and principal_point [cx, cy]."""
    two = [_as_numbers(fields.peek(key)) for key in ("focallength", "principalpoint")]
    if any(v is None or v.size != 2 for v in two):
        return None
    return tuple(float(x) for v in two if v is not None for x in v.ravel())


def _stated_size(fields: Fields) -> Size | None:
    width, height = fields.first(_WIDTH_KEYS), fields.first(_HEIGHT_KEYS)
    sizes: list[Size] = []
    # Zeros are how a message says that it does not know.
    if width is not None and height is not None and width[1] and height[1]:
        sizes.append(whole_size(width[1], height[1]))
    for keys, first_is_width in ((_SIZE_KEYS, True), (_SHAPE_KEYS, False)):
        at = fields.first(keys)
        pair = None if at is None or isinstance(at[1], str) else numbers(at[1], fields.name(at[0]))
        if pair is None or len(pair) not in ((2,) if first_is_width else (2, 3)):
            continue
        # MATLAB's sizes are rows and columns.
        first_is_width = first_is_width and "radialdistortion" not in fields
        sizes.append(whole_size(*(pair[:2] if first_is_width else pair[1::-1])))
    for other in sizes[1:]:
        if other != sizes[0]:
            raise InputError(f"two image sizes, {sizes[0][0]}x{sizes[0][1]} and {other[0]}x{other[1]} px; keep one")
    return sizes[0] if sizes else None


def _ordered(fields: Fields, found: Size | None, K: tuple[float, ...], asked: Size | None) -> Size | None:
    """A size that stands in a list, whose order the file does not say. Raises: InputError where the principal point
    speaks for the other order and the images' size was not said."""
    if found is None or any(fields.peek(key) for key in _WIDTH_KEYS):
        return found
    as_said, turned = (max(abs(c / n - 0.5) for c, n in zip(K[2:4], size)) for size in (found, (found[1], found[0])))
    if as_said < _FAR or turned > as_said / 2:
        return found
    if asked is not None and set(asked) == set(found):
        return asked
    raise InputError(
        f"the image size is written as {found[0]}, {found[1]}: as width and height the principal point "
        f"({K[2]:g}, {K[3]:g}) px lies {as_said:.0%} of the image from its middle, the other way round {turned:.0%}; "
        f"say --image-size {found[1]}x{found[0]} or {found[0]}x{found[1]}"
    )


def _with_sigma(camera: Camera, fields: Fields) -> Camera:
    """The camera with what the file says of its certainty: variances alone, since correlations live in our results."""
    sigma, names = fields.get("parametersigma"), fields.get("parameternames")
    stated: dict[str, float] = {}
    if sigma is not None:
        stated = dict(zip(str(names or "").split(), numbers(sigma, "parameter_sigma").tolist()))
    # OpenCV's interactive calibration: of fx, fy, cx, cy, and of the terms in its order.
    for key, order in (("cameramatrixstddev", REQUIRED), ("distcoeffsstddev", TERMS[:5])):
        if key in fields:
            stated |= dict(zip(order, numbers(fields.get(key), fields.name(key)).tolist()))
    if not set(camera.model.parameter_names) <= set(stated):
        return camera
    covariance = np.diag([stated[name] ** 2 for name in camera.model.parameter_names])
    if not np.all(np.isfinite(covariance)):
        raise InputError("the parameters' 1 sigma hold numbers that are not finite, or too large to be of use")
    return Camera.create(camera.model.name, camera.parameters, image_size=camera.image_size, covariance=covariance)
