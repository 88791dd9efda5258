"""The camera models by name. Adding one is its file and a line here."""

from __future__ import annotations

from calibrant.cameras.brown import Brown
from calibrant.cameras.model import CameraModel
from calibrant.cameras.pinhole import Pinhole
from calibrant.cameras.pinhole_skew import PinholeSkew
from calibrant.cameras.rational import Rational
from calibrant.cameras.thin_prism import ThinPrism
from calibrant.cameras.tilted import Tilted
from calibrant.errors import InputError

MODELS: dict[str, CameraModel] = {model.name: model for model in (Pinhole(), PinholeSkew(), Brown(), Rational(), ThinPrism(), Tilted())}


def camera_model(name: str) -> CameraModel:
    """The model of that name. Raises: InputError listing the known names."""
    if name not in MODELS:
        raise InputError(f"unknown camera model {name!r}; known models: {', '.join(MODELS)}")
    return MODELS[name]
