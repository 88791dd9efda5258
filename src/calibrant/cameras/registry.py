"""The camera models by name. Adding one is its file and a line here."""

from __future__ import annotations

from calibrant.cameras.brown import Brown
from calibrant.cameras.division import Division
from calibrant.cameras.double_sphere import DoubleSphere
from calibrant.cameras.extended_unified import ExtendedUnified
from calibrant.cameras.inverse_brown import InverseBrown
from calibrant.cameras.kannala_brandt import KannalaBrandt
from calibrant.cameras.model import CameraModel
from calibrant.cameras.orthographic import Orthographic
from calibrant.cameras.pinhole import Pinhole
from calibrant.cameras.pinhole_skew import PinholeSkew
from calibrant.cameras.rational import Rational
from calibrant.cameras.splined import EXAMPLE, FAMILY, splined
from calibrant.cameras.thin_prism import ThinPrism
from calibrant.cameras.tilted import Tilted
from calibrant.cameras.unified import Unified
from calibrant.errors import InputError
from calibrant.expected import expect

MODELS: dict[str, CameraModel] = {
    model.name: model
    for model in (
        Pinhole(),
        PinholeSkew(),
        Brown(),
        Rational(),
        ThinPrism(),
        Tilted(),
        InverseBrown(),
        Division(),
        KannalaBrandt(),
        Unified(),
        ExtendedUnified(),
        DoubleSphere(),
        Orthographic(),
        splined(EXAMPLE),
    )
}
"""One of each; the splined model is a family, of which `camera_model` builds any member."""


def camera_model(name: str) -> CameraModel:
    """The model of that name. Raises: InputError listing the known names."""
    expect(name, str, "the camera model", "a name, such as 'brown'")
    if name in MODELS:
        return MODELS[name]
    if name.startswith(f"{FAMILY}:"):
        return splined(name)
    raise InputError(f"unknown camera model {name!r}; known models: {', '.join(MODELS)}")
