"""Results of `calibrant kinematics`: a robot's geometry."""

from __future__ import annotations

from functools import partial

from calibrant.data import CalibrationResult
from calibrant.reports.parts.figures import Fact, noise_facts
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import plain
from calibrant.reports.parts.phrases import errors, transform_facts, used
from calibrant.reports.parts.robot import robot_tables

ROWS = "measurements"
_FACTS = partial(
    noise_facts, rows=ROWS, robot="measuring noise, 1σ", kept_out="RMS on measurements kept out of the fit"
)


def _answer(result: CalibrationResult) -> str:
    if result.held_out is None or result.held_out.mm is None:
        return ""
    return f"Poses kept out of the fit are met to {plain(result.held_out.mm, digits=2)} mm rms."


def _headline(result: CalibrationResult) -> list[Fact]:
    fits = [
        Fact(name, _rms(result, key), note)
        for key, name, note in (
            ("rms_before", "error before, RMS", "the robot as it was given, its best base and tool"),
            ("rms_after", "error after, RMS", "on the measurements that were fitted"),
        )
        if f"{key}_mm" in result.figures
    ]
    held = errors(result, "held-out error", facts=_FACTS)
    return [*fits, *held, *transform_facts(result.transforms[:1]), *used(result, ROWS)]


def _rms(result: CalibrationResult, key: str) -> str:
    parts = [(result.figures.get(f"{key}_{unit}"), unit) for unit in ("mm", "deg")]
    return ", ".join(f"{plain(figure.value, digits=3)} {unit}" for figure, unit in parts if figure is not None)


KIND = Kind("Kinematic calibration", _headline, _answer, _FACTS, ROWS, robot_tables)
