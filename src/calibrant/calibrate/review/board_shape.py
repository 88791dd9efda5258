"""Is the board what was said? Its flatness, its squares, its points, each a question to the scores of all views.

    board-flatness   heights a (1 - x^2) + b x y + c (1 - y^2), x and y in -1 ... 1 across the board: bent or twisted
    board-squares    the board longer along x by a factor, or its columns askew: squares that are none
    board-points     the residual of each point on the board's own plane, the mean of all views (see `board_points`)

The first two, and a shear of the image that looks alike, are unknowns beside the lens; what the views scatter among
each other (each left out in turn) says how sure they are, and the lens found with them, over its sigma, whether it
matters. A lens model that is too simple looks like a bent board: nothing is asked before the lens fits.

Rectangles show by views at several rolls: a board that was never rolled gives the camera another fx / fy instead.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.review.board_points import BoardPoints, board_points
from calibrant.calibrate.review.faults import MATTERS, Fault, Found, fault, faults
from calibrant.calibrate.review.settled import settled_stretch
from calibrant.calibrate.review.view_scores import (
    ASKEW,
    BEND,
    RADIAL,
    SHEAR,
    STRETCH,
    Rows,
    ViewScores,
    estimate,
)
from calibrant.data import Check
from calibrant.data.results import Status
from calibrant.errors import InputError
from calibrant.percent import percent

FLATNESS, SQUARES, POINTS, LENS = "board-flatness", "board-squares", "board-points", "lens-model"
FLATNESS_UNTOLD = "these views do not tell whether the board is flat"
SQUARES_UNTOLD = "the views do not tell whether the squares are square"
_TELLS = 3.0
"""Sigmas by which the data must tell square pixels on rectangles from rectangular pixels on squares."""
_MOST_NAMED = 5
_LACKED = 0.1
"""Share of a distortion that the lens model has no term for: a model with a radial term leaves under a hundredth."""
_ROUNDING = 1e-12
"""A variance this far below its own terms is what rounding left of none."""
_PRINTED = 1e-3
"""Paper is printed to about a thousandth in either direction, sensors to far less: a smaller ratio accuses nobody."""


@dataclass(frozen=True, eq=False)
class Asked:
    """checks of the board; found: the faults that all views share, None where they were not asked; moved: by how much
    each that is real moves the lens's parameters, (k,)."""

    checks: tuple[Check, ...]
    found: Found | None = None
    moved: tuple[Array, ...] = ()


def ask_board(rows: Rows, scores: ViewScores, *, target: str | None, shaped: bool, door: str) -> Asked:
    """The checks of a flat board.

    Args: target, its spec where known; shaped, whether its shape was estimated; door, the option that would do so.
    """
    sizes = np.ptp(np.ascontiguousarray(rows.stacked.points.T), axis=1)
    if not sizes[2] <= 0.01 * sizes.max():
        return Asked(())  # a target with depth has no sheet that could bend
    names = (STRETCH, ASKEW, SHEAR) if shaped else (BEND, STRETCH, ASKEW, SHEAR)
    radial = fault(scores, RADIAL)
    found = faults(scores, names)
    lens_lacks = radial is not None and radial.real and radial.independent > _LACKED
    if radial is not None and lens_lacks:
        stronger = [f for f in found.by_name.values() if f is not None and f.squares > radial.squares]
        if not stronger:
            return Asked((_lens_check(scores, radial),), moved=(radial.moved,))
    checks = [] if shaped else [_flatness_check(found.by_name[BEND], door)]
    checks += [_squares_check(rows, scores, found, target)]
    points = board_points(rows, scores, found.real)
    checks += [] if points is None else [_points_check(points, door)]
    moved = [f.moved for f in found.by_name.values() if f is not None and f.held]
    if radial is not None and radial.held and radial.independent > _LACKED:
        moved.append(radial.moved)
    if points is not None and points.moved is not None:
        moved.append(points.moved)
    return Asked(tuple(checks), found, tuple(moved))


def _lens_check(scores: ViewScores, radial: Fault) -> Check:
    """The lens has distortion that its model lacks: what the board may have beside it cannot be told."""
    size = f"{abs(radial.value[0]):.2g} px at the rim of what was seen"
    name = scores.camera.model.name
    if not radial.matters:
        message = f"the lens leaves the {name} model by {size}, which the uncertainties hold; the board is not asked"
        return Check(LENS, "ok", message, float(radial.value[0]))
    message = (
        f"the lens distorts by {size} more than the {name} model follows: free its terms, or take --model brown, "
        "rational or auto"
    )
    return Check(LENS, "warn", message, float(radial.value[0]))


def _flatness_check(bend: Fault | None, door: str) -> Check:
    if bend is None:
        return Check(FLATNESS, "ok", FLATNESS_UNTOLD)
    height, sigma = _largest_height(bend)
    size = f"{height:.2g} ± {sigma:.1g} mm"
    if not bend.real:
        message = f"the board is flat as far as the views tell: a bend of {size} is within what they scatter"
        return Check(FLATNESS, "ok", message, height)
    word = "twisted" if abs(bend.value[1]) > np.abs(bend.value[[0, 2]]).max() else "bent"
    if not bend.matters:
        message = f"the board is {word} by {size}, which the uncertainties hold; {door} paraboloid estimates it"
        return Check(FLATNESS, "ok", message, height)
    message = (
        f"the board is {word} by {size} from highest to lowest point, {times(bend.shift)}: {door} paraboloid estimates "
        "it, a stiff board has none"
    )
    return Check(FLATNESS, "warn", message, height)


@cache
def _bends() -> Array:
    """The three modes of a bend over a board, (81, 3), each without the plane closest to it."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)))
    modes = np.stack([1 - x**2, x * y, 1 - y**2], axis=-1)
    plane = np.column_stack([np.ones(len(x)), x, y])
    return np.asarray(modes - plane @ np.linalg.lstsq(plane, modes, rcond=None)[0])


def _largest_height(bend: Fault) -> tuple[float, float]:
    """Highest minus lowest point of the bend over the plane closest to it, with its sigma, mm."""
    modes = _bends()
    heights: Array = modes @ bend.value
    across = modes[np.argmax(heights)] - modes[np.argmin(heights)]
    return float(np.ptp(heights)), float(np.sqrt(across @ bend.covariance @ across))


def _squares_check(rows: Rows, scores: ViewScores, found: Found, target: str | None) -> Check:
    camera, stretch, askew = scores.camera, found.by_name[STRETCH], found.by_name[ASKEW]
    fx, fy = camera.parameters["fx"], camera.parameters["fy"]
    away = fx / fy - 1
    if stretch is not None and stretch.real:
        others = tuple(name for name in found.real if name != STRETCH)
        settled = settled_stretch(rows, scores, beside=others)
        value, sigma = settled or (float(stretch.value[0]), float(stretch.sigma[0]))
        told = f"the squares are {percent(value)} ± {percent(sigma)} {_which(value)}"
        cure = f"measure the board both ways and give both lengths{_as_spec(target, value)}"
        if not stretch.matters:
            return Check(SQUARES, "ok", f"{told}, which the uncertainties hold; {cure}", value)
        message = f"{told}, {times(stretch.shift)}: {cure}"
        return Check(SQUARES, "warn", message, value)
    if askew is not None and askew.real:
        value = float(askew.value[0])
        told = f"the board's columns lean against its rows by {percent(value)} ± {percent(float(askew.sigma[0]))}"
        cure = "a print that is askew; print it again, or --target-shape free estimates it"
        if not askew.matters:
            return Check(SQUARES, "ok", f"{told}, which the uncertainties hold ({cure})", value)
        return Check(SQUARES, "warn", f"{told}, {times(askew.shift)}: {cure}", value)
    sigma = np.inf if stretch is None else float(stretch.sigma[0])
    told_apart = stretch is not None and abs(away - float(stretch.value[0])) > _TELLS * sigma
    sigma_away = 0.0 if told_apart or abs(away) < _PRINTED else _aspect_sigma(scores)
    if 0 < _TELLS * sigma_away < abs(away):
        message = (
            f"fx / fy = {1 + away:.5f} ± {sigma_away:.1g} rests on squares that are square: the board was hardly "
            f"rolled, and squares {percent(away)} {_which(away)} with square pixels explain the views as well "
            f"({abs(fx - fy):.2g} px of fx). Measure the board both ways, or turn it by 90 deg in some views"
        )
        return Check(SQUARES, "warn", message, away)
    if sigma > _TELLS * _PRINTED:
        return Check(SQUARES, "ok", SQUARES_UNTOLD, away)
    return Check(SQUARES, "ok", f"the squares are square to {percent(sigma)} (1 sigma)", away)


def times(shift: float) -> str:
    """How much a fault is of what is uncertain of the camera. Args: its squared shift over sigma, per parameter."""
    return (
        f"which moves the camera {shift**0.5:.2g} times as far as all else that is uncertain of it (sigma holds both)"
    )


def _which(stretch: float) -> str:
    return "wider than high" if stretch > 0 else "higher than wide"


def _aspect_sigma(scores: ViewScores) -> float:
    """1 sigma of fx / fy, from what the views scatter where that can be told; 0 where the ratio was held."""
    camera = scores.camera
    i, j = camera.model.index("fx"), camera.model.index("fy")
    g = np.zeros(len(camera.values))
    g[i], g[j] = 1 / camera.values[j], -camera.values[i] / camera.values[j] ** 2
    stated = 0.0 if camera.covariance is None else float(g @ camera.covariance @ g)
    size = 0.0 if camera.covariance is None else float(np.abs(g) @ np.abs(camera.covariance) @ np.abs(g))
    if stated <= _ROUNDING * size:
        return 0.0
    n = len(scores)
    found = estimate(scores, scores.lens, leave_out=True)
    scatter = 0.0
    if found is not None and found.moved is not None:
        scatter = (n - 1) / n * float(np.sum((found.moved @ g[scores.parameter_indices]) ** 2))
    return float(np.sqrt(max(stated, scatter)))


def _as_spec(target: str | None, stretch: float) -> str:
    """How the spec would say it, the lengths' mean kept, where the kind of target can."""
    if target is None:
        return ""
    from calibrant.targets.chessboard import Chessboard  # all kinds of targets, and hardly ever asked for
    from calibrant.targets.circles import Circles
    from calibrant.targets.registry import parse_target

    try:
        known = parse_target(target)
    except InputError:
        return ""
    wide, high = (1 + stretch) ** 0.5, (1 + stretch) ** -0.5
    if isinstance(known, Chessboard):
        width, height = known.sides
        known = replace(known, square=round(width * wide, 6), height=round(height * high, 6))
    elif isinstance(known, Circles):
        down = known.spacing if known.down is None else known.down
        known = replace(known, spacing=round(known.spacing * wide, 6), down=round(down * high, 6))
    else:
        return ""
    return f", as in --target {known.spec}"


def _points_check(points: BoardPoints, door: str) -> Check:
    if points.left_out:
        named = ", ".join(str(i) for i in points.left_out[:_MOST_NAMED])
        more = f" and {len(points.left_out) - _MOST_NAMED} more" if len(points.left_out) > _MOST_NAMED else ""
        message = (
            f"{'points' if len(points.left_out) > 1 else 'point'} {named}{more} of the board did not fit in most "
            "views and counted in none of those: off its place on the print, or hidden?"
        )
        return Check(POINTS, "ok", message, float(len(points.left_out)))
    if points.chance > points.limit or points.rms_mm == 0:
        return Check(POINTS, "ok", "no point of the board is off its place, alike in every view", points.rms_mm)
    told = (
        f"points of the board are {points.rms_mm:.2g} mm rms off their places, alike in every view (most: point "
        f"{points.worst}, {points.worst_mm:.2g} ± {points.sigma_mm:.1g} mm)"
    )
    status: Status = "ok" if points.shift < MATTERS else "warn"
    if status == "ok":
        return Check(POINTS, status, f"{told}, which the uncertainties hold", points.rms_mm)
    message = f"{told}, {times(points.shift)}: look at the print and how it was cut; {door} free estimates every point"
    return Check(POINTS, status, message, points.rms_mm)
