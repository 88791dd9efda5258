"""Findings, loops and deviations as a result keeps them, of whichever data they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from calibrant.data import Measured
from calibrant.data.details import Deviations, Fault, Faults, LoopSpread, ViewDeviation
from calibrant.data.results import Status
from calibrant.diagnose.doctor.evidence.loop import Loop

_RANK = {"fail": 0, "warn": 1, "ok": 2}
Deviation = Mapping[str, tuple[float, float]]
"""mm and deg by name."""


class Told(Protocol):
    """What a finding says, of poses or of a pair's pictures; loops: before its repair and after."""

    @property
    def name(self) -> str: ...
    @property
    def status(self) -> Status: ...
    @property
    def message(self) -> str: ...
    @property
    def confidence(self) -> float: ...
    @property
    def measured(self) -> Measured | None: ...
    @property
    def views(self) -> tuple[str, ...]: ...
    @property
    def proposal(self) -> str: ...
    @property
    def loops(self) -> tuple[Loop | None, Loop | None]: ...


def rank(finding: Told) -> int:
    """What findings are sorted by: the worst first."""
    return _RANK[finding.status]


def faults(findings: Sequence[Told]) -> Faults:
    """The findings as a result keeps them."""
    return Faults(tuple(_fault(f) for f in findings))


def deviations(before: Deviation, after: Deviation, names: Sequence[str] = ()) -> Deviations:
    """How far each of some things is from where the others put it, before and after the repairs; all where none are
    named."""
    none = (None, None)
    every = names or tuple({**before, **after})
    return Deviations(tuple(ViewDeviation(n, *before.get(n, none), *after.get(n, none)) for n in every))


def loop_figures(loops: Mapping[str, Loop | None]) -> dict[str, Measured]:
    """How the loop closes, by its name, in mm and deg."""
    out: dict[str, Measured] = {}
    for name, loop in loops.items():
        if loop is not None:
            out |= {f"{name}_mm": Measured(loop.mm, unit="mm"), f"{name}_deg": Measured(loop.deg, unit="deg")}
    return out


def _fault(f: Told) -> Fault:
    before, after = (None if loop is None else LoopSpread(loop.mm, loop.deg) for loop in f.loops)
    value, sigma = (None, None) if f.measured is None else (f.measured.value, f.measured.sigma)
    return Fault(f.name, f.status, f.message, f.confidence, before, after, value, sigma, f.views, f.proposal)
