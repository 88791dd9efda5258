"""Runs of a task by which a calibration is verified: what each one's error was beside what was predicted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class TaskRun:
    """One run: its name, and its seed where it was drawn; error and what it was predicted to stay below with 95 %.

    offset_mm, sigma_mm: along x, y, z of the frame that the runs name; inside: whether that is in the predicted 95 %
    region; turned_deg, predicted_95_deg: the rotation's; after_mm, after_95_mm, after_deg, after_inside: the same with
    the corrected camera; reason: of a failure.
    """

    name: str
    passed: bool
    error_mm: float | None = None
    predicted_95_mm: float | None = None
    inside: bool | None = None
    seed: int | None = None
    offset_mm: Triple | None = None
    sigma_mm: Triple | None = None
    turned_deg: float | None = None
    predicted_95_deg: float | None = None
    after_mm: float | None = None
    after_95_mm: float | None = None
    after_deg: float | None = None
    after_inside: bool | None = None
    reason: str = ""


@dataclass(frozen=True)
class TaskRuns:
    """All runs of a task: what they are of, the frame of their offsets, the tolerance, what to do, counts beside them,
    such as those of another way to do the same, and what `after_mm` of a run is."""

    task: str
    frame: str
    runs: tuple[TaskRun, ...]
    tolerance_mm: float | None = None
    advice: str = ""
    beside: Mapping[str, str] = field(default_factory=dict)
    after: str = "after correction"
