"""COLMAP's camera models in the words of ours (colmap's src/colmap/sensor/models.h).

Its pixels are counted from the image's corner: the middle of the first one is (0.5, 0.5).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import placed_camera, whole_size
from calibrant.formats.cameras.foreign_lens import nearest_by_projection
from calibrant.formats.exchange.exchange_format import ReadOptions, Size

_PLAIN = ReadOptions()
CORNER = 0.5
"""Where the middle of the first pixel lies when pixels are counted from the image's corner."""


@dataclass(frozen=True)
class Model:
    """COLMAP's name and number, its parameters in their order, and our model; f is fx and fy, zero what must be 0."""

    name: str
    number: int
    terms: tuple[str, ...]
    ours: str | None = None
    zero: tuple[str, ...] = ()


_F, _FXY = ("f", "cx", "cy"), ("fx", "fy", "cx", "cy")
MODELS = (
    Model("SIMPLE_PINHOLE", 0, _F, "pinhole"),
    Model("PINHOLE", 1, _FXY, "pinhole"),
    Model("SIMPLE_RADIAL", 2, (*_F, "k1"), "brown"),
    Model("RADIAL", 3, (*_F, "k1", "k2"), "brown"),
    Model("OPENCV", 4, (*_FXY, "k1", "k2", "p1", "p2"), "brown"),
    Model("OPENCV_FISHEYE", 5, (*_FXY, "k1", "k2", "k3", "k4"), "kannala_brandt"),
    Model("FULL_OPENCV", 6, (*_FXY, "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"), "rational"),
    Model("FOV", 7, (*_FXY, "omega")),
    Model("SIMPLE_RADIAL_FISHEYE", 8, (*_F, "k1"), "kannala_brandt"),
    Model("RADIAL_FISHEYE", 9, (*_F, "k1", "k2"), "kannala_brandt"),
    Model(
        *("THIN_PRISM_FISHEYE", 10, (*_FXY, "k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1"), "kannala_brandt"),
        zero=("p1", "p2", "sx1", "sy1"),
    ),
    Model(
        "RAD_TAN_THIN_PRISM_FISHEYE",
        11,
        (*_FXY, "k0", "k1", "k2", "k3", "k4", "k5", "p0", "p1", "s0", "s1", "s2", "s3"),
    ),
    Model("SIMPLE_DIVISION", 12, (*_F, "l1"), "division"),
    Model("DIVISION", 13, (*_FXY, "l1"), "division"),
    Model("SIMPLE_FISHEYE", 14, _F, "kannala_brandt"),
    Model("FISHEYE", 15, _FXY, "kannala_brandt"),
    Model("EUCM", 16, (*_FXY, "alpha", "beta"), "extended_unified"),
    Model("EQUIRECTANGULAR", 17, ("w", "h")),
)
BY_NAME = {model.name: model for model in MODELS}
BY_NUMBER = {model.number: model for model in MODELS}
WRITTEN = {
    "pinhole": ("SIMPLE_PINHOLE", "PINHOLE"),
    "brown": ("SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV"),
    "rational": ("FULL_OPENCV",),
    "kannala_brandt": ("SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "OPENCV_FISHEYE"),
    "extended_unified": ("EUCM",),
}
"""Which of COLMAP's models ours is written as: the first that holds all its terms."""


def _fov(ray: Array, omega: float) -> Array:
    """Devernay and Faugeras's lens: atan(2 r tan(omega/2)) / omega."""
    x, y = ray[:, 0] / ray[:, 2], ray[:, 1] / ray[:, 2]
    r = np.hypot(x, y)
    return np.stack([x, y], axis=-1) * (np.arctan(2 * r * np.tan(omega / 2)) / (omega * np.where(r > 0, r, 1)))[:, None]


def _prism_fisheye(ray: Array, terms: Mapping[str, float]) -> Array:
    """An equidistant lens with tangential and prism terms at the angle."""
    R = np.hypot(ray[:, 0], ray[:, 1])
    scale = np.arctan2(R, ray[:, 2]) / np.where(R > 0, R, 1)
    x, y = ray[:, 0] * scale, ray[:, 1] * scale
    r2 = x * x + y * y
    k1, k2, k3, k4, p1, p2 = (terms[name] for name in ("k1", "k2", "k3", "k4", "p1", "p2"))
    g = 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
    u = x * g + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + terms["sx1"] * r2
    v = y * g + 2 * p2 * x * y + p1 * (r2 + 2 * y * y) + terms["sy1"] * r2
    return np.stack([u, v], axis=-1)


def _nearest(name: str, terms: Mapping[str, float], size: Size, options: ReadOptions) -> Camera:
    """Of the two lenses with equations here. Raises: InputError where that was not asked for."""
    focal, centre = np.array([terms["fx"], terms["fy"]]), np.array([terms["cx"], terms["cy"]])

    def project(rays: Array) -> Array:
        plane = _fov(rays, terms["omega"]) if name == "FOV" else _prism_fisheye(rays, terms)
        return plane * focal + centre

    plain = {key: terms[key] for key in ("fx", "fy", "cx", "cy")}
    start = plain if name == "FOV" else plain | {key: terms[key] for key in ("k1", "k2", "k3", "k4")}
    if name == "FOV":
        if not 0 < terms["omega"] < np.pi:
            raise InputError(f"FOV's omega is {terms['omega']:g}, expected radians between 0 and pi")
        gain = 2 * np.tan(terms["omega"] / 2) / terms["omega"]
        start = plain | {"fx": plain["fx"] * gain, "fy": plain["fy"] * gain}
    placed_camera("pinhole", plain, size, None)
    what = f"COLMAP's {name} camera"
    return nearest_by_projection(project, ("kannala_brandt",), start, size, options.answers, what=what)


def camera_of(
    name: str, width: object, height: object, values: Sequence[float], options: ReadOptions = _PLAIN
) -> Camera:
    """The camera of COLMAP's model and parameters.

    Raises: InputError: a model that is not known or that none of ours can say, a wrong count, a size that is none.
    """
    model = BY_NAME.get(name)
    if model is None:
        raise InputError(f"unknown camera model {name[:60]!r}; COLMAP's are {', '.join(BY_NAME)}")
    if len(values) != len(model.terms):
        raise InputError(f"{name} has {len(values)} parameters, expected {len(model.terms)}: {', '.join(model.terms)}")
    given = dict(zip(model.terms, (float(v) for v in values)))
    bent = [f"{term} {given.pop(term):g}" for term in model.zero if given[term] != 0]
    if model.name == "FOV" or bent:
        placed = {
            key: value - CORNER if key in ("cx", "cy") else value for key, value in zip(model.terms, map(float, values))
        }
        return _nearest(model.name, placed, whole_size(width, height), options)
    if model.ours is None:
        raise InputError(
            f"COLMAP's {name} camera is a model that calibrant does not have; let COLMAP estimate OPENCV, "
            "FULL_OPENCV or OPENCV_FISHEYE, or undistort the images (colmap image_undistorter)"
        )
    for term in model.zero:
        given.pop(term, None)
    f = given.pop("f", None)
    focal = {} if f is None else {"fx": f, "fy": f}
    middle = {"cx": given.pop("cx") - CORNER, "cy": given.pop("cy") - CORNER}
    return placed_camera(model.ours, focal | middle | given, whole_size(width, height), None)


def model_of(camera: Camera) -> tuple[Model, tuple[float, ...]]:
    """COLMAP's model with fewest terms that says this camera exactly, and its parameters in their order.

    Raises: InputError where none does.
    """
    terms = camera.parameters
    terms |= {"cx": terms["cx"] + CORNER, "cy": terms["cy"] + CORNER}
    for name in WRITTEN.get(camera.model.name, ()):
        model = BY_NAME[name]
        held = {"fx", "fy"} if "f" in model.terms else set()
        if "f" in model.terms and terms["fx"] != terms["fy"]:
            continue
        if all(value == 0 for term, value in terms.items() if term not in held | set(model.terms)):
            return model, tuple(
                terms["fx" if term == "f" else term] if term in (*terms, "f") else 0.0 for term in model.terms
            )
    raise InputError(f"COLMAP has no {camera.model.name} camera")
