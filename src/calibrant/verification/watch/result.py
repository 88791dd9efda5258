"""What was watched as a result: since when and by how much the camera has moved, or that it has not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Check, Measured, Observations, ViewResult, verdict_of
from calibrant.data.details import TaskRun, TaskRuns, WatchedPicture, Watching
from calibrant.data.verdicts import stamp
from calibrant.diagnose.movement import camera_words, figure, movement, of_camera
from calibrant.geometry import se3
from calibrant.verification.runs import run_checks, run_figures
from calibrant.verification.watch.sequential import Rule, Sight, Watch, fit_since

AXES = ("x", "y", "z")
TELLS = 13.8
"""Difference of the squares from which one explanation is a thousand times as likely as the other."""


@dataclass(frozen=True, eq=False)
class Watched:
    """All pictures after the test: the sights and the state after each, of pictures without a target why.

    places: points (3,) of the camera's frame where it works; distance of them is the mean.
    """

    sights: tuple[Sight, ...]
    states: tuple[Watch, ...]
    missed: tuple[tuple[str, str], ...] = ()
    camera: Camera | None = None
    places: tuple[Array, ...] = ()
    observations: Observations | None = field(default=None, repr=False)

    @property
    def last(self) -> Watch:
        """The state after the last picture."""
        return self.states[-1]


@dataclass(frozen=True, eq=False)
class Moved:
    """What was found of the move: its words, the camera's (6,) with covariance (6, 6) where that is told, figures."""

    words: str
    advice: str
    figures: dict[str, Measured]


def watched(sights: Sequence[Sight], rule: Rule) -> tuple[Watch, ...]:
    """The state after every picture."""
    states, state = [], Watch(rule)
    for sight in sights:
        state = state.after(sight)
        states.append(state)
    return tuple(states)


PUSHED = (
    "Push the camera back by as much and tighten it, or calibrate again: until then every point it gives is off by as "
    "much."
)


def moved_camera(watched: Watched, move: Array, covariance: Array) -> Moved:
    """The words and figures of a camera's move (6,) with its covariance."""
    T = se3.retract(np.eye(4), move)
    step = movement(T, covariance)
    figures = {f"moved {a}": Measured(float(v), float(s), "mm") for a, v, s in zip(AXES, step.mm, step.mm_sigma)}
    figures |= {f"turned {a}": Measured(float(v), float(s), "deg") for a, v, s in zip(AXES, step.deg, step.deg_sigma)}
    words = camera_words(step) or "moved by less than is certain along any one axis"
    if watched.camera is not None and watched.places:
        work = of_camera(watched.camera, T, covariance, watched.places)
        figures = {
            "at the workpiece": Measured(*work.size, "mm"),
            "in the picture": Measured(*work.size_px, "px"),
        } | figures
        words += f"; points at the workpiece are off by {figure(*work.size)} mm"
    return Moved(f"the camera {words}", PUSHED, figures)


def moved_in_hand(watched: Watched, since: int) -> Moved:
    """A camera, or a target, that moved at robot poses: which of the two explains the pictures better."""
    sights, noise = watched.sights, watched.last.starts[0].noise
    move, C, left = fit_since(sights, since, noise=noise)
    found = moved_camera(watched, move, C if sights[-1].alike is None else C + sights[-1].alike)
    if sights[0].of_other is None:
        return found
    others = [Sight(s.name, s.off, s.of_calibration, s.of_place, s.place, s.of_other, s.covariance) for s in sights
              if s.of_other is not None]  # fmt: skip
    _, _, other = fit_since(others, since, noise=noise)
    if left - other > TELLS:
        words = (
            "the target has moved, or the robot's base or its zero: that explains the pictures better than the camera"
        )
        return Moved(words, "Look at the target, the robot's base and its zero; the camera still holds.", {})
    if other - left > TELLS:
        return found
    words = f"{found.words} (or the target did the other way: these pictures do not tell the two apart)"
    return Moved(words, found.advice, found.figures)


def watch_result(watched: Watched, moved: Moved | None) -> CalibrationResult:
    """The result of kind "watch": its check of that name fails where the camera has been moved."""
    last = watched.last
    n, run = len(watched.sights), last.rule.run
    rate = f"{1e5 / run:.2g} % of runs of 1000 pictures raise a false alarm at most"
    alarm = last.alarm
    if alarm is None or moved is None:
        words = f"not moved: {n} pictures are as the calibration has them ({rate})"
        advice, since, at = "", None, None
        check = Check("watch", "ok", words, min(s.chance for s in watched.states))
    else:
        later = alarm.at - alarm.since + 1
        words = (
            f"moved since {alarm.since_name}, told by {alarm.at_name} ({later} "
            f"picture{'s' * (later > 1)} after the move): {moved.words}"
        )
        advice, since, at = moved.advice, alarm.since_name, alarm.at_name
        check = Check("watch", "fail", words, alarm.chance)
    checks = (check, *_checks(watched))
    figures = {} if moved is None or alarm is None else moved.figures
    return stamp(
        CalibrationResult(
            "watch",
            verdict_of(checks),
            checks=checks,
            views=_views(watched),
            figures={**figures, "pictures between false alarms": Measured(run)},
            details=(Watching(words, advice, run, _pictures(watched), since, at),),
            observations=watched.observations,
        )
    )


def _checks(watched: Watched) -> list[Check]:
    checks, last = [], watched.last
    if last.poor:
        names = ", ".join(last.poor[:5])
        text = f"{len(last.poor)} pictures were left out: nothing explains them and the next ones are good ({names})"
        checks.append(Check("poor-pictures", "warn", text, float(len(last.poor))))
    if last.held is not None:
        text = f"{last.held.name}, the last picture, is far from where it should be: take one more to tell"
        checks.append(Check("last-picture", "warn", text))
    if watched.missed:
        name, reason = watched.missed[0]
        text = f"{len(watched.missed)} pictures do not show what is watched, such as {name}: {reason}"
        checks.append(Check("pictures", "warn", text, float(len(watched.missed))))
    start = last.starts[-1] if last.starts else None
    if start is not None and start.noise > 4 and start.freedom < inf:
        text = (
            f"the pictures scatter {np.sqrt(start.noise):.1f} times as much as the calibration says: the limit is "
            "wider by as much"
        )
        checks.append(Check("noise", "warn", text, float(np.sqrt(start.noise))))
    return checks


def _pictures(watched: Watched) -> tuple[WatchedPicture, ...]:
    alarm, poor = watched.last.alarm, set(watched.last.poor)
    rows = []
    for i, (sight, state) in enumerate(zip(watched.sights, watched.states)):
        remark = "left out" if sight.name in poor else ""
        if alarm is not None and i >= alarm.since:
            remark = "first after the move" if i == alarm.since else "told the move" if i == alarm.at else "moved"
        rows.append(WatchedPicture(sight.name, float(state.chance), remark))
    return (*rows, *(WatchedPicture(name, None, reason) for name, reason in watched.missed))


def _views(watched: Watched) -> tuple[ViewResult, ...]:
    poor = set(watched.last.poor)
    return tuple(
        ViewResult(s.name, s.name not in poor, len(s.off) // 2, reason="poor picture" if s.name in poor else None)
        for s in watched.sights
    )


def watch_series_result(runs: Sequence[TaskRun], *, view: str, rate: float) -> CalibrationResult:
    """The result of kind "watch" over cells whose camera is moved at a picture: named in time, and not before?"""
    found = TaskRuns("watch", "camera", tuple(runs))
    checks = run_checks(found)
    figures = {**run_figures(runs), "pictures between false alarms": Measured(rate)}
    options = {"view": view, "seeds": len(runs)}
    return stamp(
        CalibrationResult(
            "watch", verdict_of(checks), checks=checks, figures=figures, details=(found,), options=options
        )
    )
