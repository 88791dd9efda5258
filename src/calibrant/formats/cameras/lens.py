"""Which lens a camera file describes: the words programs have for models, and the terms in their order.

    OpenCV, ROS, Kalibr, RealSense, Basalt, COLMAP and NeRF's files call the same few models by many names.

Names that are spelled alike by all stand in WORDS; any other is refused, since a term of an unknown model bends the
picture in an unknown way.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera, camera_model
from calibrant.cameras.plane_distortion import TERMS
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import (
    COUNTS,
    Size,
    numbers,
    placed_camera,
    smallest_model,
)
from calibrant.formats.cameras.fields import Fields, spelled

PERSPECTIVE, NO_TERMS = "perspective", "none"
WORDS: Mapping[str, tuple[str, ...]] = {
    PERSPECTIVE: (
        *("pinhole", "perspective", "plumbbob", "radtan", "radialtangential", "pinholeradtan", "brown", "brownconrady"),
        *("pinholeradialtangential", "rational", "rationalpolynomial", "pinholeskew", "opencv", "fullopencv", "cv"),
        *("opencvpinhole", "thinprism", "tilted", "rectilinear", "standard", "normal", "default", "simplepinhole"),
        *("distortedpinhole", "pinholebrownconrady", "radial", "simpleradial"),
    ),
    NO_TERMS: ("", "none", "no", "null", "undistorted", "rectified", "nodistortion"),
    "kannala_brandt": (
        *("equidistant", "equi", "fisheye", "opencvfisheye", "kannalabrandt", "kannalabrandt4", "kb", "kb4"),
        *("pinholeequi", "pinholeequidistant", "fisheyeequidistant", "equidistantfisheye", "cv2fisheye"),
    ),
    "unified": ("unified", "omni", "omnidir", "mei", "omniradtan", "cv2omnidir", "catadioptric"),
    "double_sphere": ("ds", "doublesphere"),
    "extended_unified": ("eucm", "extendedunified", "enhancedunified"),
    "inverse_brown": ("inversebrown", "inversebrownconrady"),
    "division": ("division", "divisionmodel", "fitzgibbon"),
    "orthographic": ("orthographic", "telecentric"),
}
"""What each model is called; perspective ones by OpenCV's terms, of which the count says which they are."""
_FAMILY = {word: family for family, words in WORDS.items() for word in words}
_PREFIXES = ("rs2distortion", "distortion")
_MODEL_KEYS = (
    *("cameramodel", "distortionmodel", "projectionmodel", "lensmodel", "cameratype", "distortiontype", "lenstype"),
    *("projectiontype", "projection", "modeltype", "model", "distortionmodelname", "cameramodeltype", "modelname"),
)
_FISHEYE_FLAGS = ("fisheyemodel", "fisheye", "isfisheye", "usefisheye")
_YES = ("1", "true", "yes", "on")
_TERM_KEY = re.compile(
    r"^(?:camera|cam|lens|opencv|rgb|color)?(?:dist|disto|distort|distortions?)(?:ion)?"
    r"(?:coeff?s?|coeff?icients?|params?|parameters?|vec|vector|vals?|values?|matrix|terms)?[01]?$"
    r"|^(?:camera|cam|lens)?(?:dist)?coeff?s?$|^(?:dist)?coeff?icients?$|^kc$|^d[01]?$|^dcoeff?s$"
)
_RADIAL = re.compile(r"^(?:lens)?radial(?:distortions?|coeff?s?|coeff?icients?|dist|params?|distortioncoeff?icients)?$")
_TANGENTIAL = re.compile(r"^(?:lens)?tangential(?:distortions?|coeff?s?|coeff?icients?|dist|params?)?$")
_OWN_TERMS = {
    "unified": ("xi", "k1", "k2", "p1", "p2"),
    "double_sphere": ("xi", "alpha"),
    "extended_unified": ("alpha", "beta"),
    "division": ("l1", "l2", "l3"),
    "kannala_brandt": ("k1", "k2", "k3", "k4"),
    "inverse_brown": ("k1", "k2", "p1", "p2", "k3"),
    "orthographic": (),
}
_LISTED_TERMS = {**_OWN_TERMS, "unified": ("k1", "k2", "p1", "p2")}
"""The order of terms in a list; omnidir's xi stands by itself."""


def family_of(fields: Fields) -> str | None:
    """The family of models that the file names; None where it names none. Raises: InputError for an unknown word."""
    found: dict[str, str] = {}
    for key in _MODEL_KEYS:
        if key not in fields:
            continue
        value = fields.get(key)
        if isinstance(value, Mapping | list | np.ndarray):
            raise InputError(f"{fields.name(key)} is {str(value)[:60]}, expected the name of a model")
        family = _family(value)
        if family is None:
            known = ", ".join(sorted({w for words in WORDS.values() for w in words if w}))
            raise InputError(
                f"{fields.name(key)} is {str(value)[:60]!r}, expected one of plumb_bob, rational_polynomial, "
                f"equidistant, and others, in any spelling: {known}. Where it names a device, remove the key"
            )
        found.setdefault(family, fields.name(key))
    for key in _FISHEYE_FLAGS:
        if key in fields and fields.is_flag(key) and str(fields.get(key)).strip().lower() in _YES:
            found.setdefault("kannala_brandt", fields.name(key))
    special = [family for family in found if family not in (PERSPECTIVE, NO_TERMS)]
    if len(special) > 1:
        listed = ", ".join(f"{found[family]}: {family}" for family in special)
        raise InputError(f"two models are named ({listed}); keep one")
    if special:
        return special[0]
    # pinhole is the projection; whether it is distorted the other word says.
    return NO_TERMS if NO_TERMS in found and PERSPECTIVE not in found else next(iter(found), None)


def _family(value: Any) -> str | None:
    word = spelled("" if value is None or value is False else value)
    for prefix in _PREFIXES:
        word = word.removeprefix(prefix) if word != prefix else word
    return _FAMILY.get(word)


def lens_camera(
    K: Sequence[float], fields: Fields, family: str | None, found: Size | None, size: Size | None
) -> Camera:
    """The camera of fx, fy, cx, cy, skew and the terms in `fields`.

    Args: found, size: the file's image size, the caller's.
    Raises: InputError: terms of two kinds that differ, too many or too few for the model.
    """
    fx, fy, cx, cy, skew = K
    plain = {"fx": fx, "fy": fy, "cx": cx, "cy": cy}
    listed = _listed_terms(fields)
    if "xi" in fields and family in (None, PERSPECTIVE):
        family = "unified"
    if family in _OWN_TERMS:
        values = _own_terms(family, fields, listed)
        extra = {"skew": skew} if skew and "skew" in camera_model(family).parameter_names else {}
        if skew and not extra:
            raise InputError(f"the camera matrix has skew {skew:g}; a {family} camera has none")
        return placed_camera(family, plain | extra | values, found, size)
    named = _perspective_terms(fields, listed)
    given = {name: value for name, value in named.items() if value != 0}
    if family == NO_TERMS and given:
        raise InputError(f"the model is none, and there are distortion coefficients: {given}; remove one of them")
    asked = _named_model(fields)
    model = asked if asked is not None and _holds(asked, given, skew) else smallest_model(given, skew)
    kept = {name: value for name, value in named.items() if name in camera_model(model).parameter_names}
    return placed_camera(model, plain | ({"skew": skew} if skew else {}) | kept, found, size)


def _named_model(fields: Fields) -> str | None:
    """The model of ours that the file names, as our own files do; a term that is zero is then a term still."""
    word = str(fields.get("cameramodel"))
    return word if word in ("brown", "rational", "thin_prism", "tilted") else None


def _holds(model: str, terms: Mapping[str, float], skew: float) -> bool:
    return not skew and set(terms) <= set(camera_model(model).parameter_names)


def _listed_terms(fields: Fields) -> Array | None:
    """The list of terms, by any of its names. Raises: InputError where two lists differ."""
    out: Array | None = None
    for key, value in fields.matching(_TERM_KEY).items():
        if value is None or isinstance(value, Mapping | bool) or (isinstance(value, str) and not _numeric_text(value)):
            continue
        terms = numbers(fields.get(key), fields.name(key))
        if out is not None and not np.array_equal(out, terms):
            raise InputError(f"{fields.name(key)} and another key hold distortion coefficients that differ; keep one")
        out = terms
    return out


def _numeric_text(value: str) -> bool:
    try:
        float(value)
    except ValueError:
        return False
    return True


def _own_terms(family: str, fields: Fields, listed: Array | None) -> dict[str, float]:
    """Terms of a model that is not perspective, by name."""
    named = fields.numbers_named(_OWN_TERMS[family])
    if listed is None or not listed.size:
        _refuse_missing(family, named)
        return named
    order = _LISTED_TERMS[family]
    # Longer lists are padded with zeros; brown's terms without k3 are four.
    fits = len(listed) == len(order) or (len(listed) > len(order) and not listed[len(order) :].any())
    if not fits and not (family == "inverse_brown" and len(listed) == 4) and not (family == "division" and listed.size):
        words = ", ".join(order) or "none"
        raise InputError(f"{len(listed)} distortion coefficients; a camera of the model {family} has {words}")
    if not np.all(np.isfinite(listed)):
        raise InputError(f"the distortion coefficients are {listed.tolist()}, expected finite numbers")
    if family in ("double_sphere", "extended_unified", "orthographic") and not listed.any():
        _refuse_missing(family, named)
        return named
    values = {k: float(v) for k, v in zip(order, listed)}
    _refuse_different(named, values)
    out = values | named
    _refuse_missing(family, out)
    return out


def _refuse_missing(family: str, terms: Mapping[str, float]) -> None:
    """A sphere without its place is no model; a polynomial's terms may be zero."""
    needed = {"unified": ("xi",), "double_sphere": ("xi", "alpha"), "extended_unified": ("alpha", "beta")}
    missing = [name for name in needed.get(family, ()) if name not in terms]
    if missing:
        raise InputError(f"a camera of the model {family} needs {' and '.join(missing)}, which the file does not hold")


def _perspective_terms(fields: Fields, listed: Array | None) -> dict[str, float]:
    """OpenCV's terms by name, from a list in its order, by name, or as MATLAB has them."""
    # With tz beside them tx and ty are a place, not the tilt of a sensor.
    named = fields.numbers_named(TERMS[:-2] if "tz" in fields else TERMS)
    for pattern, order in ((_RADIAL, ("k1", "k2", "k3", "k4", "k5", "k6")), (_TANGENTIAL, ("p1", "p2"))):
        for key in fields.matching(pattern):
            values = numbers(fields.get(key), fields.name(key))
            if len(values) > len(order):
                raise InputError(f"{fields.name(key)} holds {len(values)} numbers, expected {', '.join(order)} at most")
            apart = {k: float(v) for k, v in zip(order, values)}
            _refuse_different(named, apart)
            named |= apart
    if "k4" in named and named["k4"] != 0 and not {"p1", "p2", "k5", "k6"} & set(named):
        raise InputError(
            "k1 to k4 alone can be a fisheye's, or the first of a rational model; say which: distortion_model "
            "equidistant, or rational_polynomial with p1 and p2"
        )
    if listed is None:
        return named
    if len(listed) not in COUNTS or not np.all(np.isfinite(listed)):
        raise InputError(
            f"{len(listed)} distortion coefficients {listed.tolist()}; expected 4, 5, 8, 12 or 14 finite ones in "
            "OpenCV's order: k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tx ty]]]]"
        )
    in_order = {name: float(value) for name, value in zip(TERMS, listed)}
    _refuse_different(named, in_order)
    return in_order | named


def _refuse_different(named: Mapping[str, float], listed: Mapping[str, float]) -> None:
    for name, value in named.items():
        if name in listed and value != listed[name]:
            raise InputError(f"{name} is {value:g} by name, and {listed[name]:g} in a list of coefficients; keep one")
