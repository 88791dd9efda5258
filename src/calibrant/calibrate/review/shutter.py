"""Are the images sheared? Rows that a shutter reads one after the other while something moves, alike or view by view.

A row at height y is shifted by (a, b) y: in all views alike (a scan, or motion one way), or each view by its own. A
turn of the board takes up a part of it, and its tilt another; what is left is what no pose explains.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.calibrate.review.board_shape import times
from calibrant.calibrate.review.faults import Found
from calibrant.calibrate.review.view_scores import CENTRE, SHEAR, SKEW, ZOOM, ViewScores, own_of_views
from calibrant.data import Check
from calibrant.percent import percent

SHEARED, SHUTTER = "image-shear", "shutter"
_CHANCE = 1e-6
"""Chance of white noise: blur that a view's points share reaches less at times, and is no shutter."""
_NAMED = 3


def shutter_checks(scores: ViewScores, found: Found, names: Sequence[str]) -> tuple[Check, ...]:
    """Whether the images are sheared, alike or each by itself. Args: names of the views in the order of the scores."""
    alike = _alike(scores, found)
    return (alike,) if found.real else (alike, _each(scores, names))


def _alike(scores: ViewScores, found: Found) -> Check:
    """Rows of the image shifted in proportion to their place, alike in all views."""
    shear = found.by_name[SHEAR]
    if shear is None or not shear.real:
        return Check(SHEARED, "ok", "the image's rows are not shifted against each other")
    value = float(shear.value[0]) / scores.camera.image_size[1]
    told = (
        f"the image is sheared along its rows by {percent(value)} ± "
        f"{percent(float(shear.sigma[0]) / scores.camera.image_size[1])} in all views"
    )
    cure = "a rolling shutter while something moved one way, or a scan"
    if not shear.matters:
        return Check(SHEARED, "ok", f"{told}, which the uncertainties hold: {cure}", value)
    return Check(SHEARED, "warn", f"{told}, {times(shear.shift)}: {cure}", value)


def _each(scores: ViewScores, names: Sequence[str]) -> Check:
    """Whether views have shears of their own, more than they have lenses of their own."""
    own, lenses = own_of_views(scores, SKEW), own_of_views(scores, ZOOM, CENTRE)
    times = float(own.squares.sum() / max(own.freedom.sum(), 1.0))
    if own.chance > _CHANCE or times < lenses.squares.sum() / max(lenses.freedom.sum(), 1.0):
        return Check(SHUTTER, "ok", "no view is sheared along its rows by itself", times)
    noise = np.sum(1 / np.maximum(own.precision, np.finfo(float).tiny), axis=1)
    size = np.sqrt(np.maximum(np.sum(own.value**2, axis=1) - noise, 0.0))
    order = np.argsort(size - 2 * np.sqrt(noise))[::-1][:_NAMED]  # large for certain, rather than large
    worst = ", ".join(names[i].rsplit("/", 1)[-1] for i in order)
    typical = float(np.sqrt(np.average(size**2, weights=own.precision.sum(axis=1))))
    message = (
        f"views are sheared along their rows, each by itself: {typical:.2g} px an image height, most: {worst}. A "
        "rolling shutter or motion: hold still for sharper figures; the uncertainties hold it"
    )
    return Check(SHUTTER, "ok", message, typical)
