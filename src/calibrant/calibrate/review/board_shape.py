"""Is the board what was said? Its flatness, its squares, its points, each a question to the scores of all views.

    board-flatness   heights a (1 - x^2) + b x y + c (1 - y^2), x and y in -1 ... 1 across the board: bent or twisted
    board-squares    the board longer along x by a factor: a print whose squares are rectangles
    board-points     the residual of each point on the board's own plane, the mean of all views (see `board_points`)

The first two are unknowns beside the lens; what the views scatter among each other (each left out in turn) says how
sure they are, and the lens found with them, over its stated sigma, whether it matters. A lens model that is too simple
looks like a bent board: nothing is asked before the lens fits.

Rectangles show by views at several rolls: a board that was never rolled gives the camera another fx / fy instead.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.calibrate.review.board_points import BoardPoints, board_points
from calibrant.calibrate.review.view_scores import (
    BEND,
    RADIAL,
    STRETCH,
    Estimate,
    Rows,
    ViewScores,
    estimate,
    everywhere,
    kept_columns,
    lens_shift,
)
from calibrant.data import Check
from calibrant.data.results import Status
from calibrant.errors import InputError
from calibrant.optimize.chances import chi2_tail, f_tail
from calibrant.targets.chessboard import Chessboard
from calibrant.targets.circles import Circles
from calibrant.targets.registry import parse_target

FLATNESS, SQUARES, POINTS, LENS = "board-flatness", "board-squares", "board-points", "lens-model"
_CHANCE = 1e-3
"""One false finding in a thousand boards whose views err alike; it warns only where it moves the camera as well."""
_MATTERS = 1.0
"""Squared shift of the lens over its sigma, per parameter: from here on a fault takes more than the sigma stated."""
_TELLS = 3.0
"""Sigmas by which the data must tell square pixels on rectangles from rectangular pixels on squares."""
_MOST_NAMED = 5
_LACKED = 0.1
"""Share of a distortion that the lens model has no term for: a model with a radial term leaves under a hundredth."""
_PRINTED = 1e-3
"""Paper is printed to about a thousandth in either direction, sensors to far less: a smaller ratio accuses nobody."""


@dataclass(frozen=True, eq=False)
class Fault:
    """A column found beside the lens: its estimate and where in it, its covariance from the views' scatter, how much of
    it the lens does not have already (0 to 1), the chance of as much on a perfect board, and the squared shift of
    (fx, fy, cx, cy) over their sigma, per parameter."""

    found: Estimate
    own: Indices
    covariance: Array
    independent: float
    chance: float
    shift: float

    @property
    def value(self) -> Array:
        return self.found.value[self.own]

    @property
    def squares(self) -> float:
        """How much of the weighted squares it explains."""
        return self.found.chi_square(self.own)


def board_checks(rows: Rows, scores: ViewScores, *, target: str | None, shaped: bool, door: str) -> tuple[Check, ...]:
    """The checks of a flat board.

    Args: target, its spec where known; shaped, whether its shape was estimated; door, the option that would do so.
    """
    if not np.ptp(rows.stacked.points[:, 2]) <= 0.01 * np.ptp(rows.stacked.points, axis=0).max():
        return ()  # a target with depth has no sheet that could bend
    bend, stretch, radial = fault(scores, BEND), fault(scores, STRETCH), fault(scores, RADIAL)
    if (
        radial is not None
        and radial.independent > _LACKED
        and radial.chance < _CHANCE
        and not _better(bend, radial)
        and not _better(stretch, radial)
    ):
        return (_lens_check(scores, radial),)
    # The stronger is asked first, the weaker beside it: each leaves a little of itself in the other.
    if bend is not None and stretch is not None:
        if bend.chance < min(stretch.chance, _CHANCE):
            stretch = fault(scores, STRETCH, beside=BEND) or stretch
        elif stretch.chance < _CHANCE:
            bend = fault(scores, BEND, beside=STRETCH) or bend
    real = [name for name, f in ((BEND, bend), (STRETCH, stretch)) if f is not None and f.chance < _CHANCE]
    checks = [_squares_check(scores, stretch, target)]
    if not shaped:
        checks.insert(0, _flatness_check(bend, door))
    points = board_points(rows, scores, tuple(real))
    return (*checks, *([] if points is None else [_points_check(points, door)]))


def _better(board: Fault | None, lens: Fault) -> bool:
    """Whether a fault of the board explains the residuals better than one of the lens."""
    return board is not None and board.squares > lens.squares


def _lens_check(scores: ViewScores, radial: Fault) -> Check:
    """The lens has distortion that its model lacks: what the board may have beside it cannot be told."""
    size = f"{abs(radial.value[0]):.2g} px at the rim of what was seen"
    name = scores.camera.model.name
    if radial.shift < _MATTERS:
        message = f"the lens leaves the {name} model by {size}, which the uncertainties hold; the board is not asked"
        return Check(LENS, "ok", message, float(radial.value[0]))
    message = (
        f"the lens distorts by {size} more than the {name} model follows: free its terms, or take --model brown, "
        "rational or auto"
    )
    return Check(LENS, "warn", message, float(radial.value[0]))


def fault(scores: ViewScores, name: str, *, beside: str | None = None) -> Fault | None:
    """A column's estimate; None where the views do not determine it, or not without one of them."""
    names = (name,) if beside is None else (beside, name)
    columns, own = kept_columns(scores, *names)
    mine = own[-len(scores.columns[name]) :]
    weights = everywhere(scores, columns, own)
    found = estimate(scores, columns, weights)
    if found is None:
        return None
    n, q = len(scores), len(mine)
    value, covariance = found.value[mine], found.covariance[np.ix_(mine, mine)]
    chance = chi2_tail(q, found.chi_square(mine))
    shift = np.zeros(len(scores.lens))
    if chance < _CHANCE:  # beyond white noise: is it beyond what the views scatter?
        left_out = estimate(scores, columns, weights, leave_out=True)
        if left_out is None or left_out.moved is None:
            return None
        moved = left_out.moved[:, mine]
        covariance = (n - 1) / n * moved.T @ moved
        if n - q < 1 or np.linalg.matrix_rank(covariance) < q:
            return None
        statistic = float(value @ np.linalg.solve(covariance, value)) * (n - q) / (q * (n - 1))
        chance = max(float(f_tail(q, n - q, statistic)), chance)
        others = columns[np.isin(columns, columns[mine], invert=True)]
        before = estimate(scores, others, np.ones((n, len(others))))
        if before is not None:
            shift = found.value[: len(shift)] - before.value[: len(shift)]
    alone = np.einsum("nii->i", scores.gram[:, columns[mine, None], columns[mine]])
    left = np.linalg.inv(found.covariance[np.ix_(mine, mine)]) * scores.sigma_px**2
    independent = float(np.min(np.diag(left) / alone))
    return Fault(found, mine, covariance, independent, chance, lens_shift(scores, shift))


def _flatness_check(bend: Fault | None, door: str) -> Check:
    if bend is None:
        return Check(FLATNESS, "ok", "these views do not tell whether the board is flat")
    height, sigma = _largest_height(bend)
    size = f"{height:.2g} ± {sigma:.1g} mm"
    if bend.chance > _CHANCE:
        return Check(
            FLATNESS, "ok", f"the board is flat as far as the views tell ({size} from highest to lowest)", height
        )
    word = "twisted" if abs(bend.value[1]) > np.abs(bend.value[[0, 2]]).max() else "bent"
    if bend.shift < _MATTERS:
        message = f"the board is {word} by {size}, which the uncertainties hold; {door} paraboloid estimates it"
        return Check(FLATNESS, "ok", message, height)
    message = (
        f"the board is {word} by {size} from highest to lowest point, and moves the camera by "
        f"{bend.shift**0.5:.2g} of its sigma: {door} paraboloid estimates it, a stiff board has none"
    )
    return Check(FLATNESS, "warn", message, height)


def _largest_height(bend: Fault) -> tuple[float, float]:
    """Highest minus lowest point of the bend over the plane closest to it, with its sigma, mm."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)))
    modes = np.stack([1 - x**2, x * y, 1 - y**2], axis=-1)
    plane = np.column_stack([np.ones(len(x)), x, y])
    modes = modes - plane @ np.linalg.lstsq(plane, modes, rcond=None)[0]
    heights: Array = modes @ bend.value
    across = modes[np.argmax(heights)] - modes[np.argmin(heights)]
    return float(np.ptp(heights)), float(np.sqrt(across @ bend.covariance @ across))


def _squares_check(scores: ViewScores, stretch: Fault | None, target: str | None) -> Check:
    camera = scores.camera
    fx, fy = camera.parameters["fx"], camera.parameters["fy"]
    away = fx / fy - 1
    if stretch is not None and stretch.chance < _CHANCE:
        value, sigma = float(stretch.value[0]), float(np.sqrt(stretch.covariance[0, 0]))
        told = f"the squares are {_percent(value)} ± {_percent(sigma)} {_which(value)}"
        cure = f"measure the board both ways and give both lengths{_as_spec(target, value)}"
        if stretch.shift < _MATTERS:
            return Check(SQUARES, "ok", f"{told}, which the uncertainties hold; {cure}", value)
        message = f"{told}, and move the camera by {stretch.shift**0.5:.2g} of its sigma: {cure}"
        return Check(SQUARES, "warn", message, value)
    sigma_away = _aspect_sigma(scores)
    sigma = np.inf if stretch is None else float(np.sqrt(stretch.covariance[0, 0]))
    if abs(away) > max(_TELLS * sigma_away, _PRINTED) and abs(away) < _TELLS * sigma:
        message = (
            f"fx / fy = {1 + away:.5f} ± {sigma_away:.1g} rests on squares that are square: the board was hardly "
            f"rolled, and squares {_percent(away)} {_which(away)} with square pixels explain the views as well "
            f"({abs(fx - fy):.2g} px of fx). Measure the board both ways, or turn it by 90 deg in some views"
        )
        return Check(SQUARES, "warn", message, away)
    if not sigma < _TELLS * max(sigma_away, _PRINTED):
        return Check(SQUARES, "ok", "fx and fy agree; the views do not tell whether the squares are square", away)
    return Check(SQUARES, "ok", f"the squares are square to {_percent(sigma)} (1 sigma)", away)


def _percent(ratio: float) -> str:
    return f"{100 * abs(ratio):.2g} %"


def _which(stretch: float) -> str:
    return "wider than high" if stretch > 0 else "higher than wide"


def _aspect_sigma(scores: ViewScores) -> float:
    """1 sigma of fx / fy, from what the views scatter where that can be told."""
    camera = scores.camera
    i, j = camera.model.index("fx"), camera.model.index("fy")
    g = np.zeros(len(camera.values))
    g[i], g[j] = 1 / camera.values[j], -camera.values[i] / camera.values[j] ** 2
    stated = 0.0 if camera.covariance is None else float(g @ camera.covariance @ g)
    n = len(scores)
    found = estimate(scores, scores.lens, np.ones((n, len(scores.lens))), leave_out=True)
    scatter = 0.0
    if found is not None and found.moved is not None:
        scatter = (n - 1) / n * float(np.sum((found.moved @ g[scores.parameter_indices]) ** 2))
    return float(np.sqrt(max(stated, scatter)))


def _as_spec(target: str | None, stretch: float) -> str:
    """How the spec would say it, the lengths' mean kept, where the kind of target can."""
    if target is None:
        return ""
    try:
        known = parse_target(target)
    except InputError:
        return ""
    wide, high = 1 + stretch / 2, 1 - stretch / 2
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
    status: Status = "ok" if points.shift < _MATTERS else "warn"
    if status == "ok":
        return Check(POINTS, status, f"{told}, which the uncertainties hold", points.rms_mm)
    message = (
        f"{told}, and move the camera by {points.shift**0.5:.2g} of its sigma: look at the print and how it was cut; "
        f"{door} free estimates every point"
    )
    return Check(POINTS, status, message, points.rms_mm)
