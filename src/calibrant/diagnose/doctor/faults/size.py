"""A target of another size than given: the robot's motion is a ruler.

The target's scale s is freed in A_i X B_i(s) = Z, with all sources of noise (`calibrate.cell.loop_noise`, the
estimate that the calibration states too); (s - 1) / sigma_s is Student's t when the size is right.
"""

from __future__ import annotations

from functools import partial
from itertools import permutations
from typing import TYPE_CHECKING

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.loop.fit import fit_loop
from calibrant.calibrate.solvers.loop_errors import loop_consistency
from calibrant.data import Measured
from calibrant.diagnose.conventions.hypotheses import CONSISTENT
from calibrant.diagnose.doctor.evidence.case import Case
from calibrant.diagnose.doctor.evidence.finding import Finding
from calibrant.diagnose.doctor.evidence.loop import Evidence
from calibrant.diagnose.doctor.evidence.significance import CONVINCING, confidence, student_test
from calibrant.errors import RefusedError
from calibrant.formats.poses.columns import LENGTH_UNITS
from calibrant.geometry import se3

if TYPE_CHECKING:
    from calibrant.targets.circles import Circles

MATTERS = 0.005
"""A printed board is off by up to 0.5 % (a printer's scaling, paper and humidity); more is a wrong size."""
UNITS = {LENGTH_UNITS[b] / LENGTH_UNITS[a]: (a, b) for a, b in permutations(LENGTH_UNITS, 2)}
"""Real size over given size, where unit a was said and b is true; also where poses in a were read in b."""
_WORDS = {"in": "inches"}
MOST_ROUNDS, SETTLED = 20, 0.01
"""The loop is nearly linear in the scale, which settles in three or four rounds: to a hundredth of its sigma."""
ROUNDING = 1e-9
UNIT_SHARE = 0.05
"""A scale within 5 % of the ratio of two units, or within three sigma where it is not known so well, is a mistake of
units."""
SIGMAS = 3.0
NEAREST_M, FARTHEST_M = 0.1, 5.0
"""Half of a set's flanges stand farther than the one from their base, which is inside the arm's own foot, and nearer
than the other: the largest arms reach 4.7 m. Where that is so in another unit only, the poses' unit is wrong, not the
target's."""
WRONG_LENGTH = 1.1
"""A page that is fitted to its paper shrinks by up to 6 %; a target off by more than a tenth is another one, or in
another unit, or of unknown scale: no calibration is handed out of it."""


def sensitivity(case: Case) -> tuple[Array, Array]:
    """Change (6,) of X and of Z for a target larger by its own size, tangents of se3.retract: rad and m."""
    step = 1e-3  # the loop is nearly linear in the scale
    used = ~case.robust.outlier
    fits = [fit_loop(c.A, c.B, case.robust.X, used=used, certainty=c.certainty) for c in (case, case.scaled(1 + step))]
    return se3.local(fits[0].X[0], fits[1].X[0]) / step, se3.local(fits[0].Z[0], fits[1].Z[0]) / step


def examine(case: Case) -> list[Finding]:
    """Does the target's size fit the robot's motion?"""
    fit = case.size
    if fit is None:
        return []
    value, sigma = fit.size.value, fit.size.sigma
    # Off by more than any print is: the test is of what lies beyond that.
    p = student_test(max(abs(value - 1) - MATTERS, 0.0), sigma, int(fit.freedom))
    if p > CONVINCING:
        return []
    repaired = case.scaled(value)
    if loop_consistency(repaired.A, repaired.B, fit.X).score > CONSISTENT:
        return []  # motions that have nothing in common have no scale either
    return [sized(case, repaired, Measured(value, sigma), p)]


def sized(case: Case, repaired: Case, found: Measured, p: float) -> Finding:
    """The finding that the target is `found` times as large as in the case, with the case repaired."""
    value, sigma = found.value, found.sigma
    evidence = Evidence(case.loop, repaired.loop)
    gross = max(value, 1 / value) > WRONG_LENGTH
    near = max(UNIT_SHARE, SIGMAS * sigma / value)
    ratio = min(UNITS, key=lambda r: abs(value / r - 1))
    unit = UNITS[ratio] if gross and abs(value / ratio - 1) < near else None
    if unit is not None and unit[1] == case.pose_units and _arms_reach_only_times(case, 1 / ratio):
        return _of_poses(case, unit, 1 / ratio, found, p)
    text = f"{ratio_text(value, sigma)} times as large as given"
    said, true = (_WORDS.get(u, u) for u in unit or ("", ""))
    cause = f" ({said} instead of {true}, or poses in {said} were read in {true})" if unit else ""
    share = f"; at that size {evidence.text}"
    way_out = "measure the target, and give its real size"
    if unit:
        way_out = "say the unit of the target in its spec, or of the poses (--pose-units), as it is"
    else:
        misread = _misread(case, value, near) if gross else None
        if misread is not None:
            said_for, meant = misread
            cause = f" ({said_for} was given for the spacing, which is the distance of two rows)"
            way_out = f"give the distance of two rows: --target {meant.spec}, or what the target measures"
    if case.data.views is None:
        way_out += ", or, for a track of unknown scale, --target-scale free"
    return Finding(
        "target-size",
        "fail" if gross else "warn",
        f"the target's size does not fit the robot's motion: the target is {text}{cause}{share}",
        confidence(p),
        evidence,
        measured=Measured(value * case.scale, sigma * case.scale),
        proposal=way_out,
        repair=partial(Case.scaled, factor=value),
        gain=max(case.misfit - repaired.misfit, 0.0),
    )


def _distance(case: Case) -> float:
    """Median distance of the robot's poses from its base, m."""
    return float(np.median(np.linalg.norm(case.data.T_base_gripper[case.index, :3, 3], axis=1)))


def _arms_reach_only_times(case: Case, factor: float) -> bool:
    """Whether the robot's poses are those of an arm only once they are this many times as far from its base."""
    distance = _distance(case)
    return not NEAREST_M <= distance <= FARTHEST_M and NEAREST_M <= factor * distance <= FARTHEST_M


def _of_poses(case: Case, unit: tuple[str, str], factor: float, found: Measured, p: float) -> Finding:
    """The finding that the robot's poses are in another unit of length, and the target is as given."""
    evidence = Evidence(case.loop, case.with_poses_larger(factor).loop)
    true, read = _WORDS.get(unit[0], unit[0]), unit[1]
    moves = Measured(1 / found.value, found.sigma / found.value**2)
    message = (
        f"the robot's positions are in {true} and were read in {read}: the target moves "
        f"{ratio_text(moves.value, moves.sigma)} times as far as they do, and half of them lie "
        f"{'within' if factor > 1 else 'beyond'} {_distance(case):.2g} m of the base, as no arm's do; read in {true} "
        f"{evidence.text}"
    )
    return Finding(
        "pose-units",
        "fail",
        message,
        confidence(p),
        evidence,
        proposal=f"say it: --pose-units {unit[0]}",
        repair=partial(Case.with_poses_larger, factor=factor),
        gain=max(case.misfit - case.scaled(found.value).misfit, 0.0),
    )


def _misread(case: Case, value: float, near: float) -> tuple[str, Circles] | None:
    """Which distance of a grid of circles was given for another, and the grid that was meant."""
    spec = None if case.observations is None else case.observations.target
    if spec is None:
        return None
    from calibrant.targets.circles import Circles  # all kinds of targets, and hardly ever asked for
    from calibrant.targets.registry import parse_target

    if not spec.startswith(f"{Circles.kind}:"):
        return None
    target = parse_target(spec)
    return target.misread(value * case.scale, within=near) if isinstance(target, Circles) else None


def ratio_text(value: float, sigma: float) -> str:
    """A ratio and its 1 sigma, to two digits of the latter."""
    digits = max(4, 1 - int(np.floor(np.log10(sigma)))) if sigma > 0 else 4
    return f"{value:.{min(digits, 9)}f} ± {sigma:.{min(digits, 9)}f}"


def freed(case: Case) -> tuple[Case, Measured]:
    """The case at the size that the robot's motion says, and that size in units of the one given.

    Raises: RefusedError where the motion does not tell it.
    """
    start = case.scale
    for _ in range(MOST_ROUNDS):
        fit = case.size
        if fit is None:
            break
        value, sigma = fit.size.value, fit.size.sigma
        case = case.scaled(value)
        if abs(value - 1) < max(SETTLED * sigma, ROUNDING):
            return case, Measured(case.scale / start, sigma * case.scale / start)
    raise RefusedError(
        "the motions do not tell the target's scale (--target-scale free): robot poses that change place, not only "
        "direction, tell it; or give it as a number"
    )
