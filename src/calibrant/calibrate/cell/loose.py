"""A rig whose cameras do not fit together, in the order of cause and effect.

Clocks, frames that do not belong together and cameras that moved bend lenses that are free, and what is asked of lenses
then answers for them. The rig's own question stands first; where a lens fails, the rig is refused for its cause.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from calibrant.calibrate.cell.moments.at_once import MOVED
from calibrant.calibrate.cell.moments.late import led_back
from calibrant.calibrate.cell.moments.sightings import poses, trees
from calibrant.calibrate.cell.problem.layout import Layout
from calibrant.calibrate.cell.problem.views import HandEyeViews
from calibrant.data import CalibrationResult, Check, verdict_of

RIGIDITY, BENT = "rigidity", "one-camera"
_CLOCKS = "--time-offsets"


def cause_first(result: CalibrationResult) -> CalibrationResult:
    """The result of a rig that is loose with that in front, and no lens refused for it."""
    loose = next((c for c in result.checks if c.name == RIGIDITY and c.status == "warn"), None)
    if loose is None:
        return result
    by_clocks = _CLOCKS in loose.message
    bent = [c for c in result.checks if c.name.startswith(BENT) and c.status == "fail"]
    if bent:
        names = ", ".join(dict.fromkeys(c.name.removeprefix(BENT).lstrip("-") for c in bent))
        moves = [f"; {c.message}" for c in result.checks if c.name.startswith(MOVED) and not by_clocks]
        text = f"{loose.message}. What is found of the lens of {names} bends after it{''.join(moves)}"
        loose = replace(loose, status="fail", message=text)
    rest = [_effect(c, by_clocks=by_clocks) for c in result.checks if c.name != RIGIDITY]
    checks = (loose, *rest)
    return replace(result, checks=checks, verdict=verdict_of(checks))


def _effect(check: Check, *, by_clocks: bool) -> Check:
    """A check in the words of one whose cause is another's."""
    if check.name.startswith(BENT) and check.status == "fail":
        return replace(check, status="warn", message=f"as the rig bends it ({RIGIDITY}): {check.message}")
    if by_clocks and check.name.startswith("together-") and check.status == "warn":
        return replace(check, message=f"{check.message.split(': the cameras')[0]}: the clocks, as {RIGIDITY} says")
    return check


def late_words(where: Layout, data: Sequence[HandEyeViews], times: Mapping[str, float]) -> str:
    """By how much cameras are late, by their views' poses alone; empty where none shows or times are not known."""
    said = []
    for pair in trees(where, data):
        moments = [data[s.list].ids[s.row] for s in pair.seen_b]
        if len(moments) < 3 or not set(moments) <= set(times):
            continue
        led = led_back(poses(data, pair.seen_a), poses(data, pair.seen_b), moments, times)
        if led.late:
            said.append(f"{pair.b} some {1e3 * led.seconds:+.0f} ms against {pair.a}")
    if not said:
        return ""
    return (
        f"clocks: the cameras' views agree far better as if taken late by {', '.join(said)}; {_CLOCKS} finds such "
        "times; where they are more than a frame, number the frames as they were taken"
    )
