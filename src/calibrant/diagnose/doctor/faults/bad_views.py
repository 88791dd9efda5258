"""Single views that disagree with all others and with every repair: a wrong pose, a wrong image, a misread board."""

from __future__ import annotations

from functools import partial

import numpy as np

from calibrant.calibrate.cell.starts.robust import Group, agreeing_group, disagreement
from calibrant.diagnose.doctor.evidence.case import Case, loop_of
from calibrant.diagnose.doctor.evidence.finding import Finding
from calibrant.diagnose.doctor.evidence.loop import Evidence
from calibrant.diagnose.doctor.evidence.significance import confidence
from calibrant.geometry import se3

MOST = 1 / 3
"""Where more of the views disagree, the fault is not in single views."""


def examine(case: Case) -> list[Finding]:
    """Views beyond the noise of the others. To be asked last: leaving out explains nothing."""
    out = np.flatnonzero(case.condemned)
    if len(out) == 0:
        return []
    fit = case.robust.fit
    names = tuple(case.ids[k] for k in out)
    evidence = Evidence(case.loop, loop_of(fit.deviation[~case.condemned]))
    if len(out) > MOST * len(case.index):
        group = agreeing_group(case.A, case.B, certainty=case.certainty)
        if group is None:
            group = Group(~case.condemned, evidence.after.mm, evidence.after.deg)
        names = tuple(name for name, member in zip(case.ids, group.members) if not member)
        message = disagreement(len(case.index), group, names)
        p = float(case.robust.p_value[out].max()) * len(case.index)
        return [Finding("views-disagree", "fail", message, confidence(p), evidence, names)]
    found = []
    for k, name in zip(out, names):
        mm, deg = se3.mm_and_deg(fit.deviation[k])
        reason = (
            f"its robot pose and its image disagree by {mm:.3g} mm and {deg:.2g} deg, the others agree to "
            f"{evidence.after.text}: a wrong pose, a wrong image or a misread board"
        )
        found.append(
            Finding(
                "bad-pose",
                "warn",
                f"{name}: {reason}",
                confidence(min(1.0, float(case.robust.p_value[k]) * len(case.index))),
                evidence,
                (name,),
                proposal="leave the view out",
                repair=partial(Case.without, rows=[int(case.index[k])], reason=f"left out: {reason}"),
            )
        )
    return found
