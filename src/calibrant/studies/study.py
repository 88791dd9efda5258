"""What `calibrant study methods` does, from its arguments to a study."""

from __future__ import annotations

from collections.abc import Callable

from calibrant.data import Observations
from calibrant.studies import methods as study_methods
from calibrant.studies import sweeps as study_sweeps
from calibrant.studies.page import Compared, Study
from calibrant.studies.scenes import Case, Conditions, observed_case, plane_case, solid_case
from calibrant.studies.stereo_pair import compared_pairs
from calibrant.studies.sweeps import Sweep, Swept

REPEAT = 3
"""Runs of which the fastest is a method's time: the first of a process also loads what it needs."""

SYNTHETIC_TRUTH = "Errors against the simulated truth."
OBSERVED_TRUTH = (
    "Errors against the full solution of all views: the truth is not known. The principal point is taken to be the "
    "image's middle and pixels to be square where a method needs them."
)


def synthetic(conditions: Conditions, *, trials: int, step: Callable[[str], None]) -> Study:
    """All methods on simulated views, and every condition under which they fail, `trials` scenes a value (0: none)."""
    compared: list[Compared] = []
    for case in (plane_case(conditions), solid_case(conditions)):
        compared += _compared_methods(case)
    step("methods")
    pairs = compared_pairs(conditions)
    step("stereo")
    sweeps = study_sweeps.SWEEPS if trials else ()
    swept = [_swept(one, conditions, trials, step) for one in sweeps]
    subject = (
        f"Simulated views: {conditions.views} of a plane and of two boards at right angles, about {conditions.points} "
        f"points each, noise {conditions.noise_px:g} px, lens {conditions.lens}, seed {conditions.seed}"
    )
    return Study(subject, SYNTHETIC_TRUTH, _options(conditions, trials), tuple(compared), tuple(swept), pairs)


def observed(found: Observations, *, name: str) -> Study:
    """All methods that take the target, on the views of a real camera."""
    case = study_methods.with_reference(observed_case(found))
    truth = OBSERVED_TRUTH if case.camera is not None else "No truth is known, and all views together have no solution."
    return Study(f"{name}: {len(case.views)} views", truth, {}, tuple(_compared_methods(case)), ())


def steps(trials: int) -> int:
    """How often `synthetic` calls `step`."""
    return 2 + (sum(len(s.values) for s in study_sweeps.SWEEPS) if trials else 0)


def _compared_methods(case: Case) -> list[Compared]:
    out = []
    for method in study_methods.fitting(case):
        outcomes = study_methods.runs(method, case, repeat=REPEAT)
        median, refused = study_methods.summary(outcomes)
        out.append(Compared(method, median, len(outcomes), refused))
    return out


def _swept(one: Sweep, conditions: Conditions, trials: int, step: Callable[[str], None]) -> Swept:
    def counted() -> None:
        step(one.title)

    return study_sweeps.sweep(one, conditions, trials=trials, step=counted)


def _options(conditions: Conditions, trials: int) -> dict[str, object]:
    return {
        "seed": conditions.seed,
        "noise_px": conditions.noise_px,
        "points": conditions.points,
        "views": conditions.views,
        "lens": conditions.lens,
        "trials": trials,
    }
