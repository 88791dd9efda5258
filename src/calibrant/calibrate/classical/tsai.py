"""Tsai's calibration in two steps from one view (lecture 001, slides 52 to 63; Tsai 1987).

Step one finds R, t_x and t_y from the directions of the points, which no radial distortion changes (`alignment`); step
two finds t_z, the focal length and the radial term (`depth`). The principal point (C_x, C_y) is taken as known, and for
coplanar points mu = f_y / f_x too (slide 52). One view is enough.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from calibrant.calibrate.classical import planar as planar_start
from calibrant.calibrate.classical.alignment import Scale, align, align_coplanar
from calibrant.calibrate.classical.depth import finished
from calibrant.calibrate.classical.points import (
    ClassicalCalibration,
    assumed,
    checked_aspect,
    checked_pairs,
    dimension,
    image_centre,
)
from calibrant.calibrate.classical.radial import RadialModel, checked_radial
from calibrant.calibrate.classical.refusals import COPLANAR, NOT_COPLANAR, Degenerate

LEAST_COPLANAR = 5
LEAST_POINTS = 7


def calibrate_tsai_coplanar(
    points: ArrayLike,
    uv: ArrayLike,
    *,
    image_size: tuple[int, int],
    centre: ArrayLike | None = None,
    aspect: float | None = None,
    radial: RadialModel = "division",
    scale: Scale = "t_y",
) -> ClassicalCalibration:
    """Focal length, one radial term and pose from one view of a plane: slides 53 to 63.

    Args: points (n, 3) metres in a plane, n >= 5; uv (n, 2) px; centre (2,) px, (C_x, C_y), the image's middle when not
    given; aspect, f_y / f_x, 1 when not given; radial, the lens (see `radial`), by slide 50's when not given; scale,
    what step one divides by. t_y = 0 means the origin of the plane's own frame; of a target in z = 0 that is the
    target's.
    Returns a camera of the model `radial`, one pose, and what was taken as known without being given (`assumed`).
    Raises: InputError for unusable arguments; Degenerate for too few or collinear points, points with depth,
    t_y = 0, a plane that faces the camera, no positive focal length.
    """
    checked_radial(radial)
    p, m = checked_pairs(points, uv, least=LEAST_COPLANAR, method="Tsai's method for coplanar points")
    mu, middle = checked_aspect(aspect), image_centre(image_size, centre)
    if dimension(p) > 2:
        raise Degenerate(
            NOT_COPLANAR, "this form of Tsai's method takes points of one plane; for points with depth use the other"
        )
    plane = planar_start.in_plane(p)
    image = m - middle
    alignment = align_coplanar(plane.xy, image, aspect=mu, scale=scale)
    flat = np.column_stack([plane.xy, np.zeros(len(p))])
    found = finished(alignment, flat, image, radial=radial, centre=middle, image_size=image_size, mirrored=True)
    unsaid = assumed(middle, centre, aspect=aspect, takes_aspect=True)
    return ClassicalCalibration(found.camera, found.T_camera_target @ plane.T_plane_target, unsaid)


def calibrate_tsai(
    points: ArrayLike,
    uv: ArrayLike,
    *,
    image_size: tuple[int, int],
    centre: ArrayLike | None = None,
    radial: RadialModel = "division",
    scale: Scale = "t_y",
) -> ClassicalCalibration:
    """Focal lengths, one radial term and pose from one view of points with depth: seven unknowns in step one.

    s_x = f_x / f_y comes out of step one (Tsai 1987); the slides, which treat coplanar points, take it as
    known. Args: points (n, 3) metres, n >= 7, not coplanar; the others as `calibrate_tsai_coplanar`.
    Raises: InputError for unusable arguments; Degenerate for too few, collinear or coplanar points, t_y = 0,
    no positive focal length.
    """
    checked_radial(radial)
    p, m = checked_pairs(points, uv, least=LEAST_POINTS, method="Tsai's method for points with depth")
    middle = image_centre(image_size, centre)
    if dimension(p) < 3:
        raise Degenerate(
            COPLANAR,
            f"all {len(p)} points lie in a plane, which leaves r3, r6 and s_x open in this form of Tsai's method; use "
            "the form for coplanar points, with a known aspect",
        )
    image = m - middle
    alignment = align(p, image, scale=scale)
    found = finished(alignment, p, image, radial=radial, centre=middle, image_size=image_size, mirrored=False)
    return replace(found, assumed=assumed(middle, centre, takes_aspect=False))
