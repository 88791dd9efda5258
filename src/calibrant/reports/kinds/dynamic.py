"""Results of `calibrant dynamic`: an external camera by a wrist camera, and what its uncertainty is made of."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.reports.parts.figures import Fact, noise_facts
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import plain
from calibrant.reports.parts.phrases import first_transform, placed

SHARE = "variance by "
"""What the names of the shares begin with."""


def _facts(result: CalibrationResult) -> list[Fact]:
    shares = [
        Fact(name, f"{plain(100 * share.value, digits=2)} %", "of the variance of the external camera's position")
        for name, share in sorted(result.figures.items(), key=lambda item: -item[1].value)
        if name.startswith(SHARE)
    ]
    return [*noise_facts(result), *shares]


KIND = Kind("Dynamic calibration", placed, first_transform, _facts)
