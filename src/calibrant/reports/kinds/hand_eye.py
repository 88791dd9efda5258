"""Results of `calibrant hand-eye`: where cameras, targets and robots are."""

from __future__ import annotations

from functools import partial

from calibrant.data import CalibrationResult, TransformEstimate
from calibrant.data.details import ArmErrors
from calibrant.reports.parts.blocks import TextTable
from calibrant.reports.parts.figures import Fact, is_point, noise_facts
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import plain, sigma_text
from calibrant.reports.parts.phrases import known, placed, transform_facts
from calibrant.reports.parts.robot import robot_tables

UNTOLD = "beside what this arm's own geometry errs by{size} (--robot-accuracy, --identify)"
"""What no data of one arm hold: errors that are alike at all of its poses."""


def _camera_transforms(result: CalibrationResult) -> list[TransformEstimate]:
    """Where the cameras are, of a result with several; else the first transform, which is what was asked for."""
    if len(result.cameras) < 2:
        return list(result.transforms[:1])
    return [t for t in result.transforms if t.child in result.cameras and t.parent not in result.cameras]


def _headline(result: CalibrationResult) -> list[Fact]:
    # What was asked about stands first.
    return [*_in_workspace(result), *placed(result, _camera_transforms(result)), *_tips(result)]


def _tips(result: CalibrationResult) -> list[Fact]:
    """Tips of tools, and points that they touched."""
    return transform_facts(t for t in result.transforms if is_point(t))


def _in_workspace(result: CalibrationResult) -> list[Fact]:
    """How far off a seen point is at the worst place that was asked about, by camera where there are several."""
    begin = "workspace_sigma"
    return [
        Fact(f"in the workspace{name.removeprefix(begin)}, 1σ", f"{plain(figure.value, digits=2)} mm", "worst place")
        for name, figure in result.figures.items()
        if name.startswith(begin)
    ]


def _answer(result: CalibrationResult) -> str:
    text = known(_camera_transforms(result))
    if not text or result.options.keys() & {"robot_accuracy", "identify"}:
        return text
    return f"{text.removesuffix('.')}, {UNTOLD.format(size=_unseen(result))}."


def _unseen(result: CalibrationResult) -> str:
    """The size of what the arms' geometry may do without its data showing it; the worst of several."""
    errors = result.detail(ArmErrors)
    if errors is None or not errors.robots:
        return ""
    worst = max(errors.robots.values(), key=lambda e: e.camera_mm)
    how = f", assumed, for {plain(worst.unseen_mm, digits=2)} mm at the flange" if worst.assumed else ""
    return f" without showing it: {sigma_text(worst.camera_mm)} mm{how}"


def _tables(result: CalibrationResult) -> list[TextTable]:
    return robot_tables(result)


KIND = Kind(
    "Hand-eye calibration",
    _headline,
    _answer,
    # Pixels by the robot's word for where it is: many times the RMS error, which has no robot in it.
    facts=partial(noise_facts, kept_out="RMS on views kept out of the fit, the robot's own error in it"),
    tables=_tables,
)
