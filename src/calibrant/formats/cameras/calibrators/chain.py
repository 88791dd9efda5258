"""One camera of Kalibr's chain files, which OpenVINS writes too: models, lists of numbers, the image's size.

    camera_model + distortion_model    here              intrinsics              distortion_coeffs
    pinhole + none                     pinhole           fu fv pu pv             (none)
    pinhole + radtan                   brown             fu fv pu pv             k1 k2 p1 p2
    pinhole + equidistant              kannala_brandt    fu fv pu pv             k1 k2 k3 k4
    pinhole + fov                      the nearest       fu fv pu pv             w
    omni + radtan, none                unified           xi fu fv pu pv          k1 k2 p1 p2
    eucm + none                        extended_unified  alpha beta fu fv pu pv  (none)
    ds + none                          double_sphere     xi alpha fu fv pu pv    (none)

The field-of-view lens of Devernay and Faugeras: r_d = atan(2 r tan(w / 2)) / w. Pixels are counted from the middle of
the first one: targets are found with OpenCV's sub-pixel corners and projected onto them as they are. Source: Kalibr's
kalibr_common/ConfigReader.py and aslam_cameras (its wiki, "Supported models").
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.formats.cameras.calibrators.rigid import finite
from calibrant.formats.cameras.camera_format import Size, placed_camera, whole_size
from calibrant.formats.cameras.fields import spelled
from calibrant.formats.cameras.foreign_lens import nearest_by_rays
from calibrant.formats.documents.number_text import digits

MODELS = ("pinhole", "brown", "kannala_brandt", "unified", "extended_unified", "double_sphere")
LACKS: Mapping[str, tuple[str, ...]] = {"brown": ("k3",), "unified": ("skew",)}
"""What can be said, and which of their terms cannot."""
USED = ("camera_model", "intrinsics", "distortion_model", "distortion_coeffs", "resolution")
_FOCAL = ("fx", "fy", "cx", "cy")
_BEFORE = {"omni": ("xi",), "eucm": ("alpha", "beta"), "ds": ("xi", "alpha"), "pinhole": ()}
_RADTAN, _EQUIDISTANT = ("k1", "k2", "p1", "p2"), ("k1", "k2", "k3", "k4")
_OURS = {
    ("pinhole", "none"): ("pinhole", ()),
    ("pinhole", "radtan"): ("brown", _RADTAN),
    ("pinhole", "equidistant"): ("kannala_brandt", _EQUIDISTANT),
    ("omni", "radtan"): ("unified", _RADTAN),
    ("omni", "none"): ("unified", ()),
    ("eucm", "none"): ("extended_unified", ()),
    ("ds", "none"): ("double_sphere", ()),
}
_OPENCVS = {5: ("brown", (*_RADTAN, "k3")), 8: ("rational", (*_RADTAN, "k3", "k4", "k5", "k6"))}
"""Longer lists, which other programs write under the word radtan: OpenCV's order."""
_THEIRS = {
    "pinhole": ("pinhole", "none"),
    "brown": ("pinhole", "radtan"),
    "kannala_brandt": ("pinhole", "equidistant"),
    "unified": ("omni", "radtan"),
    "extended_unified": ("eucm", "none"),
    "double_sphere": ("ds", "none"),
}
_WORDS = {
    "equi": "equidistant",
    "fisheye": "equidistant",
    "kannalabrandt": "equidistant",
    "radialtangential": "radtan",
    "plumbbob": "radtan",
    "": "none",
    "null": "none",
    "doublesphere": "ds",
    "omnidir": "omni",
    "mei": "omni",
}


def is_chain_camera(node: Any) -> bool:
    """Whether a mapping is a camera of a chain."""
    return isinstance(node, Mapping) and "camera_model" in node and isinstance(node.get("intrinsics"), list)


def chain_camera(node: Mapping[str, Any], size: Size | None, source: str, answers: Mapping[str, str]) -> Camera:
    """The camera of a chain's node. Raises: InputError for unknown words, and counts that are not the model's."""
    projection, distortion = _word(node.get("camera_model")), _word(node.get("distortion_model"))
    if projection not in _BEFORE:
        raise InputError(f"{source}: camera_model is {projection!r}, expected one of {', '.join(_BEFORE)}")
    names = (*_BEFORE[projection], *_FOCAL)
    values = _named(names, node.get("intrinsics"), f"{source}: intrinsics of {projection}")
    found = _size(node, source)
    coefficients = finite(node.get("distortion_coeffs") or [], f"{source}: distortion_coeffs")
    if (projection, distortion) == ("pinhole", "fov"):
        return _fov(values, coefficients, found or size, source, answers)
    if (projection, distortion) not in _OURS:
        known = ", ".join(f"{p} with {d}" for p, d in (*_OURS, ("pinhole", "fov")))
        raise InputError(f"{source}: {projection} with distortion_model {distortion!r}; expected {known}")
    ours, terms = _OURS[projection, distortion]
    if (projection, distortion) == ("pinhole", "radtan") and len(coefficients) in _OPENCVS:
        ours, terms = _OPENCVS[len(coefficients)]
    if terms or coefficients.any():
        values |= _named(terms, coefficients, f"{source}: distortion_coeffs of {distortion}")
    return placed_camera(ours, values, found, size)


@dataclass(frozen=True)
class ChainWords:
    """A camera as Kalibr says it: the two models, their numbers in its order (px, and the lens's terms)."""

    projection: str
    distortion: str
    intrinsics: tuple[float, ...]
    coefficients: tuple[float, ...]


def camera_words(camera: Camera) -> ChainWords:
    """A camera of one of `MODELS` in Kalibr's words."""
    values = camera.parameters
    projection, distortion = _THEIRS[camera.model.name]
    names, terms = (*_BEFORE[projection], *_FOCAL), _OURS[projection, distortion][1]
    return ChainWords(projection, distortion, tuple(values[n] for n in names), tuple(values[n] for n in terms))


def camera_lines(camera: Camera, indent: str) -> list[str]:
    """The lines of a chain of a camera that it can say."""
    words = camera_words(camera)
    width, height = camera.image_size
    return [
        f"{indent}camera_model: {words.projection}",
        f"{indent}intrinsics: [{', '.join(map(digits, words.intrinsics))}]",
        f"{indent}distortion_model: {words.distortion}",
        f"{indent}distortion_coeffs: [{', '.join(map(digits, words.coefficients))}]",
        f"{indent}resolution: [{width}, {height}]",
    ]


def _word(value: Any) -> str:
    word = spelled("" if value is None else value)
    return _WORDS.get(word, word)


def _named(names: tuple[str, ...], values: Any, what: str) -> dict[str, float]:
    found = finite(values, what)
    if len(found) != len(names):
        raise InputError(f"{what} holds {len(found)} numbers, expected {', '.join(names) or 'none'}")
    return {name: float(value) for name, value in zip(names, found)}


def _size(node: Mapping[str, Any], source: str) -> Size | None:
    if "resolution" not in node:
        return None
    pair = node["resolution"]
    if not isinstance(pair, list) or len(pair) != 2:
        raise InputError(f"{source}: resolution is {str(pair)[:40]!r}, expected [width, height]")
    return whole_size(*pair)


def _fov(values: dict[str, float], terms: Array, size: Size | None, source: str, answers: Mapping[str, str]) -> Camera:
    if len(terms) != 1 or not 0 < terms[0] < np.pi:
        raise InputError(f"{source}: distortion_coeffs of fov is {terms.tolist()}, expected w between 0 and pi")
    if size is None:
        raise InputError(f"{source}: no resolution; say --image-size")
    return fov_camera(values, float(terms[0]), size=size, source=source, answers=answers)


def fov_camera(values: Mapping[str, float], w: float, *, size: Size, source: str, answers: Mapping[str, str]) -> Camera:
    """The nearest camera to a field-of-view lens of fx, fy, cx, cy px and w rad."""
    f, centre = np.array([values["fx"], values["fy"]]), np.array([values["cx"], values["cy"]])

    def rays(uv: Array) -> Array:
        m = (uv - centre) / f
        rd = np.linalg.norm(m, axis=-1)
        inside = rd * w < np.pi / 2
        r = np.where(inside, np.tan(rd * w) / (2 * np.tan(w / 2)), np.nan)
        scale = np.where(rd > 0, r / np.where(rd > 0, rd, 1.0), w / (2 * np.tan(w / 2)))
        return np.concatenate([m * scale[:, None], np.ones((len(m), 1))], axis=1)

    focal = float(np.sqrt(abs(f.prod()))) * 2 * np.tan(w / 2) / w
    return nearest_by_rays(rays, size, answers, focal_px=focal, centre=centre, what=f"{source}: a fov lens")
