"""Can the camera model see as much as the lens? Asked when a perspective fit is far worse than detectors are."""

from __future__ import annotations

import numpy as np

from calibrant.calibrate.classical import planar as planar_start
from calibrant.calibrate.reprojection.factor import StackedViews
from calibrant.calibrate.starts import any_lens as camera_start
from calibrant.calibrate.starts.with_depth import is_flat
from calibrant.cameras import Camera, CameraModel
from calibrant.data import Check
from calibrant.errors import RefusedError

SUSPICIOUS_RMS_PX = 0.5
"""Detectors locate points to a few tenths of a pixel; a fit above this is at a wrong optimum or has a wrong model."""
PERSPECTIVE_REACH_DEG = 75.0
"""From the axis; beyond it a perspective image is four times as large as a fisheye's, and no lens is built so."""
WIDE_MODELS = "kannala_brandt, unified, extended_unified, double_sphere"


def model_check(camera: Camera, views: StackedViews, rms_px: float) -> tuple[Check, ...]:
    """A failed check in words when a perspective model meets a lens that it cannot follow; else nothing."""
    kind = camera.model
    if rms_px <= SUSPICIOUS_RMS_PX or kind.projection != "perspective":
        return ()
    reach = _reach_deg(views, camera.image_size)
    if reach is None or reach <= PERSPECTIVE_REACH_DEG:
        return ()
    text = f"residuals of {rms_px:.2g} px rms are far above what detectors leave: {wide_lens(kind, reach)}"
    return (Check("lens", "fail", text, rms_px),)


def wide_lens(kind: CameraModel, reach_deg: float) -> str:
    """Words for a lens that is too wide for its model."""
    return (
        f"the views reach about {reach_deg:.0f} degrees from the axis, and a {kind.name} camera sees less than 90. "
        f"Use a model for wide lenses ({WIDE_MODELS}), or --model auto"
    )


def refuse_wide_lens(kind: CameraModel, views: StackedViews, image_size: tuple[int, int]) -> None:
    """Raise a RefusedError in words when a perspective model met a lens that it cannot follow."""
    reach = _reach_deg(views, image_size)
    if kind.projection == "perspective" and reach is not None and reach > PERSPECTIVE_REACH_DEG:
        raise RefusedError(f"lens: {wide_lens(kind, reach)}")


def _reach_deg(views: StackedViews, image_size: tuple[int, int]) -> float | None:
    """Largest angle from the axis by the closed-form start; None where the views determine no lens, or have depth."""
    if not is_flat(views.points):
        return None
    try:
        xy = planar_start.in_plane(views.points).xy
        start = camera_start.radial_start(xy, views.uv, views.offsets, image_size)
    except RefusedError:
        return None
    return float(np.rad2deg(start.angles(views.uv).max()))
