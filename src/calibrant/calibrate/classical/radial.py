"""The lecture's radial lens models (001, slides 47 to 50) by the names that they have here.

Slides 47, 49 and 50 stand side by side and are three models, not one. With (X, Y) pixels from the principal point,
mu = f_y / f_x, r^2 = mu^2 X^2 + Y^2 and x/z, y/z the ideal coordinates of a point:

    slide 47, `brown`           X = f_x x/z (1 + k' r'^2),  r' the radius of the ideal point   distorts; k1 = k1
    slide 49, `inverse_brown`   X (1 + k r^2) = f_x x/z,    r the radius of the seen point     undistorts; k1 = k f_y^2
    slide 50, `division`        X / (1 + k r^2) = f_x x/z,  r the radius of the seen point     undistorts; l1 = k f_y^2

Slide 48 puts the seen radius in place of the ideal one, which turns 47 into 50's form. For a small k r^2 the k of slide
49 is minus that of slide 50. Slide 50's is the one that makes step two of Tsai's method linear (slide 62).
"""

from __future__ import annotations

from typing import Literal, get_args

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError

RadialModel = Literal["division", "inverse_brown", "brown", "pinhole"]

TERM = {"division": "l1", "inverse_brown": "k1", "brown": "k1"}


def checked_radial(radial: str) -> None:
    """Raises: InputError for a model that the classical methods do not have."""
    if radial not in get_args(RadialModel):
        raise InputError(
            f"radial is one of division (slide 50), inverse_brown (slide 49), brown (slide 47) or pinhole (no "
            f"distortion); got {radial!r}"
        )


def radial_camera(
    radial: RadialModel, *, fx: float, aspect: float, term: float, centre: Array, image_size: tuple[int, int]
) -> Camera:
    """The camera with f_x and mu f_x, one radial term (dimensionless, of coordinates X / f_x) and centre (2,) px."""
    parameters = {"fx": fx, "fy": aspect * fx, "cx": float(centre[0]), "cy": float(centre[1])}
    if radial != "pinhole":
        parameters[TERM[radial]] = term
    return Camera.create(radial, parameters, image_size=image_size)


def slide_k(camera: Camera) -> float:
    """k of slides 48 to 50 in px^-2, or k' f^2 of slide 47 (1) for `brown`, from a camera that `radial_camera` made.

    Raises: InputError for a camera of another model.
    """
    if camera.model.name not in TERM:
        raise InputError(f"the lecture's k is that of {', '.join(TERM)}; the camera is {camera.model.name}")
    term = camera.parameters[TERM[camera.model.name]]
    return term if camera.model.name == "brown" else term / camera.parameters["fy"] ** 2
