"""The doctor's look at the pictures of two cameras; with `apply`, the pair calibrated from the repaired ones."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

from calibrant.errors import InputError, RefusedError
from calibrant.tasks.cameras.stereo_pictures import StereoPictures, pictures_of
from calibrant.tasks.inputs import session
from calibrant.tasks.inputs.by_side import SIDES
from calibrant.tasks.listener import Listener
from calibrant.tasks.options.images import CornerOptions, PairPhotoOptions, PairSearchOptions, SearchOptions
from calibrant.tasks.outcome import NextStep, Outcome

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult
    from calibrant.diagnose.doctor.pairs.diagnosis import PairDiagnosis
    from calibrant.diagnose.look import Look


@dataclass(frozen=True, kw_only=True)
class PairRequest:
    """What the doctor was asked of a pair."""

    pair: PairPhotoOptions
    target: str | None
    search: SearchOptions
    model: str
    apply: bool
    listener: Listener


def pictures(request: PairRequest) -> StereoPictures:
    """The images of both, paired. Raises: InputError for a side or a board that is missing."""
    if request.target is None:
        raise InputError("the pictures need the board they show: --target, such as chessboard:9x6:25mm")
    if request.search.mirror_x:
        raise InputError(
            "--mirror-x flips the pictures of one camera: leave it out, the doctor finds which is mirrored"
        )
    search = PairSearchOptions(
        exclude=request.search.exclude, workers=request.search.workers, cache=request.search.cache
    )
    return pictures_of(
        left=request.pair.left,
        right=request.pair.right,
        targets=dict.fromkeys(SIDES, request.target),
        observations=None,
        rule=request.pair.pairs,
        table=None,
        search=search,
        corners=CornerOptions(),
        listener=request.listener,
    )


def run(request: PairRequest) -> Outcome:
    """What was found, or the pair from repaired pictures; faults that stand unrepaired are the outcome's refusal."""
    from calibrant.data import Check
    from calibrant.data.verdicts import stamp
    from calibrant.diagnose.doctor.pairs.diagnosis import as_result, diagnose_pairs
    from calibrant.diagnose.look import look

    found = pictures(request)
    observations = found.read()
    session.load_solver(request.listener)
    with request.listener.status("Examining the pictures …"):
        diagnosis = diagnose_pairs(observations)
    inputs = session.file_records(found.inputs)
    result = as_result(diagnosis)
    result = stamp(replace(result, checks=(Check("pairing", "ok", found.paired), *result.checks), inputs=inputs))
    if not request.apply:
        return Outcome(result=result, then=_then(diagnosis), refusal=_refusal(diagnosis))
    seen = look(result)
    try:
        with request.listener.status("Calibrating from the repaired pictures …"):
            repaired = _repaired(diagnosis, request.model)
    except RefusedError as error:
        return Outcome(summary=lambda: seen, refusal=error)
    repaired = replace(repaired, inputs=inputs)
    return Outcome(result=repaired, summary=lambda: (seen, "", repaired), page=partial(_page, seen))


def _repaired(diagnosis: PairDiagnosis, model: str) -> CalibrationResult:
    """The pair; what was repaired is said as warnings. Raises: RefusedError for a fault that only a person can cure."""
    from calibrant.calibrate.stereo.calibrate import calibrate_stereo
    from calibrant.data import Check, verdict_of

    hopeless = [f for f in diagnosis.findings if f.status == "fail" and f.repair is None]
    if hopeless:
        raise RefusedError(f"{hopeless[0].name}: {hopeless[0].text}")
    result = session.with_misses(calibrate_stereo(diagnosis.repaired.observations, model=model))
    done = (Check(f.name, "warn", f"repaired: {f.message}", f.confidence) for f in diagnosis.findings)
    checks = (*done, *result.checks)
    return replace(result, checks=checks, verdict=verdict_of(checks))


def _page(seen: Look) -> str:
    from calibrant.reports.html import report_page

    return report_page(seen)


def _refusal(diagnosis: PairDiagnosis) -> RefusedError | None:
    if not diagnosis.findings:
        return None
    names = ", ".join(dict.fromkeys(f.name for f in diagnosis.findings))
    told = "found and not repaired" if diagnosis.sound else "the data are not fit for calibration"
    cure = "; --apply calibrates from repaired data" if _is_repairable(diagnosis) else ""
    return RefusedError(f"{told}: {names}{cure}")


def _is_repairable(diagnosis: PairDiagnosis) -> bool:
    return bool(diagnosis.findings) and all(f.repair is not None for f in diagnosis.findings)


def _then(diagnosis: PairDiagnosis) -> NextStep | None:
    """The command that calibrates: from repaired pictures where there are any, else from those given."""
    if _is_repairable(diagnosis):
        files = ("--apply", "--out", "repaired.json", "--report", "repaired.html")
        return NextStep("calibrate from the repaired pictures", "doctor", files)
    if not diagnosis.findings:
        return NextStep("calibrate", "stereo", ("--out", "stereo.json", "--report", "stereo.html"))
    return None
