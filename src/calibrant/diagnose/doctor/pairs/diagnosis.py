"""All that is wrong with a pair's pictures, one fault after the other, each undone before the next is asked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.data import CalibrationResult, Check, Observations, ViewResult, verdict_of
from calibrant.diagnose.doctor.evidence.told import deviations, faults, loop_figures, rank
from calibrant.diagnose.doctor.pairs.case import LensOf, PairCase, pair_case
from calibrant.diagnose.doctor.pairs.finding import PairFinding
from calibrant.diagnose.doctor.pairs.lenses import exchanged, mirrored, of_another_camera
from calibrant.diagnose.doctor.pairs.orders import examine, exchanged_partners
from calibrant.diagnose.doctor.pairs.standing import moved, not_at_once, sides
from calibrant.geometry import se3

QUESTIONS = (of_another_camera, mirrored, examine, exchanged, moved, exchanged_partners, not_at_once, sides)
"""Leaving pairs out explains nothing and comes last; which side is which is asked of pairs that agree."""
MOST_FAULTS = 12


@dataclass(frozen=True, eq=False)
class PairDiagnosis:
    """given, repaired: the pairs before and after the repairs; findings, worst first."""

    given: PairCase
    repaired: PairCase
    findings: tuple[PairFinding, ...]

    @property
    def sound(self) -> bool:
        """True when nothing failed."""
        return all(f.status != "fail" for f in self.findings)


def diagnose_pairs(observations: Observations, *, lens: LensOf | None = None) -> PairDiagnosis:
    """Diagnose the views of two cameras that are fixed to each other; the first of the observations is the left one.

    lens: who says a camera's lens; by its own views unless given.
    Raises: InputError for other than two cameras; RefusedError where they share too few moments.
    """
    given = case = pair_case(observations, lens=lens)
    findings: list[PairFinding] = []
    while len(findings) < MOST_FAULTS:
        found = next((f for ask in QUESTIONS if (f := ask(case)) is not None), None)
        if found is None:
            break
        findings.append(found)
        if found.repair is None:
            break
        case = pair_case(found.repair(case.observations), case, lens)
    return PairDiagnosis(given, case, tuple(sorted(findings, key=rank)))


def as_result(diagnosis: PairDiagnosis) -> CalibrationResult:
    """The diagnosis as a result of kind "doctor": findings as checks, every pair with how far it is from the others."""
    checks = tuple(
        Check(f.name, f.status, f.text, f.measured.value if f.measured else f.confidence) for f in diagnosis.findings
    )
    given, repaired = diagnosis.given, diagnosis.repaired
    views = tuple(ViewResult(v.id, True, len(v), camera=v.camera) for side in repaired.seen for v in side)
    agree = int((~repaired.wrong).sum())
    text = f"{given.right} to {given.left}, by {len(repaired)} pairs, of which {agree} agree"
    return CalibrationResult(
        kind="doctor",
        verdict=verdict_of(checks),
        checks=checks,
        views=views,
        figures=loop_figures({"loop_before": given.loop, "loop_after": repaired.loop}),
        decided={"pairs": text},
        details=(faults(diagnosis.findings), deviations(_off(given), _off(repaired))),
    )


def _off(case: PairCase) -> dict[str, tuple[float, float]]:
    """mm and deg of each pair from where the others put the right camera, by the left view's name."""
    mm, deg = se3.deviation(np.broadcast_to(case.place, case.found.D.shape), case.found.D)
    return {name: (float(a), float(b)) for name, a, b in zip(case.found.names_a, mm, deg)}
