"""Identification: the model's parameters from measurements, with what can be told apart, noise, outliers, hold-out.

    start -> which parameters -> solve with the noise levels -> drop what is known too badly -> set outliers aside
          -> solve again -> held-out error

A parameter whose sigma exceeds what a maker's tolerance would say anyway is held at its nominal value: fitted, it would
only carry noise into poses between the measured ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.calibrate.kinematics.identifiability import select
from calibrant.calibrate.kinematics.model import Gravity, ModelParameter, RobotModel, joint_terms
from calibrant.calibrate.kinematics.problem import (
    FLOORS,
    POSITION,
    ROTATION,
    START_SIGMAS,
    ModelErrors,
    model_errors,
    model_problem,
)
from calibrant.calibrate.kinematics.shared_errors import with_shared_errors
from calibrant.calibrate.kinematics.start import base_and_tool, free_chain
from calibrant.data.joint_measurements import JointMeasurements
from calibrant.errors import InputError, RefusedError
from calibrant.optimize.levenberg_marquardt import solve
from calibrant.optimize.noise import NoiseLevel, estimate_noise
from calibrant.optimize.solution import Solution
from calibrant.robots.geometry import ParametricChain
from calibrant.robots.limits import check_limits

WEAKEST = {"m": 0.010, "rad": np.deg2rad(1.0), "1": 0.02, "rad/Nm": 1e-4, "m/N": 1e-5}
"""Largest sigma of a robot parameter worth fitting. Arms are machined to tenths of millimetres and hundredths of
degrees, so what is known to 10 mm or 1 degree only is known better from the drawing; a gear is never wrong by 2 %, a
joint of an industrial arm never softer than 1e-4 rad/Nm (5e-7 to 1e-5 are published)."""

OUTLIER_PROBABILITY = 1e-3
"""Chance of setting anything aside when all measurements are good."""
MOST_OUTLIERS = 0.2
"""With more than a fifth beyond the noise it is the model that does not fit, not some measurements."""
FOLDS = 5


@dataclass(frozen=True)
class IdentifiedParameter:
    """A parameter's correction to its starting value and 1 sigma, in its unit; reason says why it was not fitted."""

    parameter: ModelParameter
    correction: float
    sigma: float | None
    reason: str = ""


@dataclass(frozen=True, eq=False)
class KinematicCalibration:
    """The robot as identified.

    nominal: the model with the starting geometry and the base and tool that fit it best; model: as identified.
    covariance (p, p) of all parameters, zero where held. noise: levels "position" (m) and "rotation" (rad), per axis.
    before, after: errors of the two models on the measurements used; held_out: of models fitted without them.
    used (n,): False for outliers. base_free, tool_free: whether these were unknown.
    shared_times: how much wider sigma is for errors that neighbours share.
    """

    nominal: RobotModel
    model: RobotModel
    parameters: tuple[IdentifiedParameter, ...]
    covariance: Array
    noise: Mapping[str, NoiseLevel]
    measurements: JointMeasurements
    used: Mask
    before: ModelErrors
    after: ModelErrors
    held_out: ModelErrors | None
    outlier_sizes: Array
    free_model: bool
    shared_times: float
    base_free: bool
    tool_free: bool

    @property
    def fitted(self) -> tuple[IdentifiedParameter, ...]:
        """The parameters that were determined."""
        return tuple(p for p in self.parameters if p.sigma is not None)


@dataclass(frozen=True, eq=False)
class _Fit:
    model: RobotModel
    covariance: Array
    noise: Mapping[str, NoiseLevel]
    solution: Solution


def calibrate_kinematics(
    measurements: JointMeasurements,
    chain: ParametricChain | None = None,
    *,
    identify: Sequence[str] = ("offsets", "geometry"),
    hold: Sequence[str] = (),
    gravity: Gravity | None = None,
) -> KinematicCalibration:
    """Identify a robot's geometry; without `chain`, a product of exponentials in the measuring frame.

    Args: identify, any of offsets, geometry, gear, coupling, elasticity; hold, any of base (the measuring frame is the
    robot's base) and tool (what is measured is the flange); gravity, the masses, for elasticity.
    Raises: InputError for joints of a wrong number or beyond their limits, unknown options; RefusedError when the
    measurements cannot determine the model.
    """
    _check_options(identify, hold)
    if chain is None:
        # A free model has no offsets, base or tool: its axes stand in the measuring frame, its zeros are its own.
        groups, hold = {*identify, "geometry"} - {"offsets"}, ("base", "tool")
        terms = joint_terms(measurements.joints.shape[1], sorted(groups))
        start = nominal = RobotModel(free_chain(measurements), np.eye(4), np.eye(4), terms, gravity=gravity)
    else:
        check_limits(chain, measurements.joints, measurements.ids)
        terms = joint_terms(len(chain.joints), identify)
        base, tool = base_and_tool(chain, measurements, hold_base="base" in hold, hold_tool="tool" in hold)
        start = RobotModel(chain, base, tool, terms, gravity=gravity)
        frames = {"base", "tool"} - set(hold)
        groups = {*identify, *frames}
        nominal = _fitted_frames(start, measurements, frames)
    candidates = np.array([p.group in groups for p in start.parameters])
    posed = measurements.rotations is not None
    if not posed:  # a point has no orientation
        candidates &= [not p.name.startswith("tool rotation") for p in start.parameters]
    chosen = select(nominal, measurements.joints, candidates, rotations_measured=posed)
    _require_frames(nominal, candidates, chosen.keep, chosen.reasons)
    reasons = dict(chosen.reasons)
    fit, keep = _fit_known_well(nominal, measurements, chosen.keep, reasons)
    used, sizes = _without_outliers(fit, measurements)
    if not used.all():
        fit = _fit_model(fit.model, measurements.take(np.flatnonzero(used)), keep)
    kept = measurements.take(np.flatnonzero(used))
    covariance, times = with_shared_errors(fit.solution, kept.joints)
    fit = replace(fit, covariance=covariance)
    return KinematicCalibration(
        nominal=nominal,
        model=fit.model,
        parameters=_report(nominal, fit, candidates, keep, reasons),
        covariance=fit.covariance,
        noise=fit.noise,
        measurements=measurements,
        used=used,
        before=model_errors(nominal, kept),
        after=model_errors(fit.model, kept),
        held_out=_held_out_errors(fit, kept, keep),
        outlier_sizes=sizes,
        free_model=chain is None,
        shared_times=times,
        base_free="base" not in hold,
        tool_free="tool" not in hold,
    )


def _check_options(identify: Sequence[str], hold: Sequence[str]) -> None:
    known = ("offsets", "geometry", "gear", "coupling", "elasticity")
    for name in identify:
        if name not in known:
            raise InputError(f"cannot identify {name!r}; choose among {', '.join(known)}")
    for name in hold:
        if name not in ("base", "tool"):
            raise InputError(f"cannot hold {name!r}; base and tool can be held")


def _fitted_frames(model: RobotModel, measurements: JointMeasurements, groups: set[str]) -> RobotModel:
    """The nominal robot with the best base and tool: what it is worth before calibration."""
    free = np.array([p.group in groups for p in model.parameters])
    if measurements.rotations is None:
        free &= [not p.name.startswith("tool rotation") for p in model.parameters]
    free = select(model, measurements.joints, free, rotations_measured=measurements.rotations is not None).keep
    if not free.any():
        return model
    solution = solve(model_problem(model, measurements, free))
    return model.with_state(solution.value("model")[0])


def _require_frames(model: RobotModel, candidates: Mask, keep: Mask, reasons: Mapping[int, str]) -> None:
    """Raises: RefusedError when the base or the tool cannot be told from each other."""
    lost = [k for k, p in enumerate(model.parameters) if p.group in ("base", "tool") and candidates[k] and not keep[k]]
    if lost and reasons[lost[0]].startswith("these poses"):
        raise RefusedError(
            f"the measurements do not determine {model.parameters[lost[0]].name}: {reasons[lost[0]]}; or hold "
            "the frame if it is known (--hold base, --hold tool)"
        )


def _fit_model(model: RobotModel, measurements: JointMeasurements, free: Mask) -> _Fit:
    count = measurements.positions.size + (0 if measurements.rotations is None else measurements.positions.size)
    unknowns = int(free.sum())
    if count <= unknowns:
        raise RefusedError(
            f"{len(measurements)} measurements give {count} numbers for {unknowns} unknowns; "
            f"take at least {unknowns * 2 * len(measurements) // count + 1} measurements, or identify less"
        )
    estimate = estimate_noise(model_problem(model, measurements, free), sigmas=START_SIGMAS, floors=FLOORS)
    solution = estimate.solution
    if not solution.converged:
        raise RefusedError(f"the identification did not settle: {solution.message}; check joints, poses and units")
    return _Fit(model.with_state(solution.value("model")[0]), solution.covariance("model"), estimate.levels, solution)


def _fit_known_well(
    nominal: RobotModel, measurements: JointMeasurements, keep: Mask, reasons: dict[int, str]
) -> tuple[_Fit, Mask]:
    """The fit of those parameters that it determines well enough; the worst is dropped, one at a time.

    What is left after a drop is judged from the same normal matrix, and fitted once at the end.
    """
    fit = _fit_model(nominal, measurements, keep)
    allowed = [WEAKEST[p.unit] if p.group not in ("base", "tool") else np.inf for p in nominal.parameters]
    rows = np.flatnonzero(keep)
    scale = np.sqrt(np.diag(fit.covariance)[rows])
    information = np.linalg.inv(fit.covariance[np.ix_(rows, rows)] / np.outer(scale, scale))
    left = np.ones(len(rows), dtype=bool)
    while True:
        at = np.flatnonzero(left)
        sigma = scale[at] * np.sqrt(np.diag(np.linalg.inv(information[np.ix_(at, at)])))
        ratio = sigma / np.array(allowed)[rows[at]]
        worst = int(np.argmax(ratio))
        if ratio[worst] <= 1:
            break
        k = int(rows[at[worst]])
        left[at[worst]] = False
        reasons[k] = (
            f"known to {figure(sigma[worst], nominal.parameters[k].unit)} only, worse than a maker's tolerance; "
            "kept at its nominal value"
        )
    if left.all():
        return fit, keep
    kept = np.zeros_like(keep)
    kept[rows[left]] = True
    return _fit_model(nominal, measurements, kept), kept


def figure(value: float, unit: str) -> str:
    """A number in a person's units: mm and degrees."""
    if unit == "m":
        return f"{1e3 * value:.3g} mm"
    if unit == "rad":
        return f"{np.rad2deg(value):.3g} deg"
    return f"{value:.3g}" if unit == "1" else f"{value:.3g} {unit}"


def _without_outliers(fit: _Fit, measurements: JointMeasurements) -> tuple[Mask, Array]:
    """Measurements within the noise, by the chi-square of each; and how many sigma each is off."""
    from scipy.stats import chi2

    errors = model_errors(fit.model, measurements)
    squares = (1e-3 * errors.mm / fit.noise[POSITION].sigma) ** 2
    if errors.deg is not None:
        squares = squares + (np.deg2rad(errors.deg) / fit.noise[ROTATION].sigma) ** 2
    dim = 3 if errors.deg is None else 6
    # The noise of the bulk: outliers must not widen the net they are caught in.
    spread = max(float(np.median(squares) / chi2.median(dim)), 1e-300)
    squares = squares / min(spread, 1.0)
    used = squares < chi2.isf(OUTLIER_PROBABILITY / len(measurements), dim)
    if (~used).mean() > MOST_OUTLIERS:
        used = np.ones(len(measurements), dtype=bool)
    return used, np.sqrt(squares / dim)


def _held_out_errors(fit: _Fit, measurements: JointMeasurements, keep: Mask) -> ModelErrors | None:
    """Errors on each fifth of the measurements of a model fitted to the others; None when these are too few."""
    n = len(measurements)
    fold = np.random.default_rng(0).permutation(n) % FOLDS
    numbers = 3 if measurements.rotations is None else 6
    if n < 2 * FOLDS or numbers * (n - n // FOLDS - 1) <= int(keep.sum()):
        return None
    sigmas = {group: level.sigma for group, level in fit.noise.items()}
    mm, deg = np.zeros(n), np.zeros(n)
    for k in range(FOLDS):
        rows = np.flatnonzero(fold != k)
        solution = solve(model_problem(fit.model, measurements.take(rows), keep, sigmas=sigmas))
        out = np.flatnonzero(fold == k)
        errors = model_errors(fit.model.with_state(solution.value("model")[0]), measurements.take(out))
        mm[out] = errors.mm
        if errors.deg is not None:
            deg[out] = errors.deg
    return ModelErrors(mm, None if measurements.rotations is None else deg)


def _report(
    nominal: RobotModel, fit: _Fit, candidates: Mask, keep: Mask, reasons: Mapping[int, str]
) -> tuple[IdentifiedParameter, ...]:
    delta = nominal.steps_to(fit.model)
    sigma = np.sqrt(np.diag(fit.covariance))
    return tuple(
        IdentifiedParameter(p, float(delta[k]), float(sigma[k]))
        if keep[k]
        else IdentifiedParameter(p, 0.0, None, reasons[k])
        for k, p in enumerate(nominal.parameters)
        if candidates[k]
    )


def identified_robot(calibration: KinematicCalibration) -> ParametricChain:
    """The corrected chain, joint offsets made part of its geometry; gears, couplings, elasticity are not in it."""
    model = calibration.model
    offsets = np.zeros(len(model.chain.joints))
    for term, amount in zip(model.terms, model.amounts.tolist()):
        if term.kind == "offsets":
            offsets[term.joint] += amount
    return model.chain.with_joint_offsets(offsets)
