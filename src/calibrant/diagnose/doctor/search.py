"""The search: the most convincing repair is taken, the data are examined again, until nothing convincing is left.

Faults hide each other: a shifted list makes every view an outlier, a moved target hides a flipped board in its shorter
part. So one fault is taken out at a time, the one that makes the data most likely. Leaving views out explains nothing
and comes last.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from calibrant.calibrate.cell.starts.robust import agreeing_group, disagreement
from calibrant.calibrate.solvers.loop_errors import loop_consistency
from calibrant.cancel import checkpoint
from calibrant.diagnose.conventions.hypotheses import CONSISTENT
from calibrant.diagnose.doctor.evidence.case import Case
from calibrant.diagnose.doctor.evidence.finding import Finding
from calibrant.diagnose.doctor.evidence.loop import Loop
from calibrant.diagnose.doctor.evidence.significance import confidence
from calibrant.diagnose.doctor.faults import (
    bad_views,
    boards,
    exchanged,
    intrinsics,
    markers,
    motions,
    moved,
    pairing,
    size,
    swapped,
    timing,
)

Examine = Callable[[Case], list[Finding]]

EXPLAINING: tuple[Examine, ...] = (
    pairing.examine,
    boards.examine,
    swapped.examine,
    moved.examine,
    timing.examine,
    size.examine,
)
"""Faults whose repair makes the data agree. A new fault is one file and one line here."""
ONCE: tuple[Examine, ...] = (intrinsics.examine,)
"""Faults of the images that are looked for once, before the loop is judged."""
REMARKS: tuple[Examine, ...] = (exchanged.examine, markers.examine)
"""Faults that do not touch the loop."""
MOST_ROUNDS = 12
"""Repairs one after the other; data with more faults than this are not worth repairing."""
LEAST_POSES = 3
STILL_OPEN = ("no-agreement", "views-disagree")
"""Findings about all that is left when nothing more can be repaired."""


@dataclass(frozen=True, eq=False)
class Examination:
    """What was found, the case as given and with every repair applied; before, after: its loop."""

    findings: tuple[Finding, ...]
    case: Case
    repaired: Case
    before: Loop | None
    after: Loop | None

    @property
    def judged(self) -> bool:
        """False when the motions determine nothing, so that the loop says nothing."""
        return self.before is not None

    @property
    def sound(self) -> bool:
        """True when nothing failed."""
        return all(f.status != "fail" for f in self.findings)

    def named(self, name: str) -> tuple[Finding, ...]:
        """The findings of that name."""
        return tuple(f for f in self.findings if f.name == name)


def examine(case: Case) -> Examination:
    """Everything that is wrong with a case, in the order of repair.

    Raises: InputError for poses that are not rigid.
    """
    still = motions.examine(case)
    if len(case.index) < LEAST_POSES or any(f.status == "fail" for f in still):
        return Examination(tuple(still), case, case, None, None)
    found: list[Finding] = []
    current = case
    for ask in ONCE:
        current = _repaired(current, ask(current), found)
    for _ in range(MOST_ROUNDS):
        proposals = [f for ask in EXPLAINING for f in _asked(ask, current)]
        # What nobody can repair is said once, and keeps nothing else from being found.
        said = {f.name for f in found}
        found += [f for f in proposals if f.repair is None and f.name not in said]
        proposals = [f for f in proposals if f.repair is not None]
        if not proposals:
            proposals = bad_views.examine(current)
            if not proposals:
                break
            current = _repaired(current, proposals, found)
            if any(f.repair is None for f in proposals):
                break
            continue
        best = max(proposals, key=lambda f: f.gain)
        current = _repaired(current, [best], found)
    found += [f for ask in REMARKS for f in ask(current)]
    if not any(f.name == "views-disagree" for f in found):
        found += _open_loop(current)
    if any(f.name in STILL_OPEN and f.status == "fail" for f in found):
        found, current = [_no_repair(f) for f in found], case
    # Motions are judged by what is left: repairs may have left too little.
    left = motions.examine(current) if current is not case else still
    return Examination((*_merged(found), *left), case, current, case.loop, current.loop)


def _no_repair(finding: Finding) -> Finding:
    """What was found on the way to a loop that stays open: it closes nothing, and is no repair to propose."""
    if not finding.proposal:
        return finding
    message = f"{finding.message}; with that undone the loop stays open all the same"
    return replace(finding, message=message, proposal="", repair=None)


def _asked(ask: Examine, case: Case) -> list[Finding]:
    """What one question finds. Raises: CancelledError."""
    checkpoint()
    return ask(case)


def _open_loop(case: Case) -> list[Finding]:
    """The finding that nothing closes the loop: medians still as large as the motion itself."""
    loop = loop_consistency(case.A, case.B, case.robust.X)
    if loop.score <= CONSISTENT:
        return []
    group = agreeing_group(case.A, case.B, certainty=case.certainty)
    if group is not None and not group.members.all():
        others = [name for name, member in zip(case.ids, group.members) if not member]
        message = disagreement(len(case.index), group, others)
        return [Finding("views-disagree", "fail", message, views=tuple(others))]
    ask = "do poses and images belong together, is it the right target?"
    if loop.score_rotation <= CONSISTENT:
        ask = (
            f"the rotations agree to {loop.median_deg:.2g} deg, the positions do not: are they in the frame that the "
            "rotations are in, their axes in the same order and right-handed, the rotations not inverted alone?"
        )
    message = (
        f"robot and target poses do not describe the same motion: the loop leaves {case.loop.text}, {loop.score:.0%} "
        f"of the motion itself; {ask}"
    )
    # Unrelated motions agree to within a quarter of themselves in half of the views about once in 4^(n / 2).
    return [Finding("no-agreement", "fail", message, confidence(0.25 ** (len(case.index) / 2)))]


def _repaired(case: Case, proposals: list[Finding], found: list[Finding]) -> Case:
    """The case with these repairs applied; the findings are noted."""
    for finding in proposals:
        found.append(finding)
        if finding.repair is not None:
            case = finding.repair(case)
    return case


def _merged(found: list[Finding]) -> list[Finding]:
    """One finding of the target's size: the last one measured it with everything else repaired."""
    sizes = [f for f in found if f.name == "target-size"]
    if len(sizes) < 2:
        return found
    last = replace(sizes[-1], evidence=sizes[0].evidence and replace(sizes[0].evidence, after=sizes[-1].evidence.after))  # type: ignore[union-attr]
    return [f for f in found if f.name != "target-size"] + [last]
