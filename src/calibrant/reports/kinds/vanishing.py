"""Results of `calibrant vanishing`: a rotation against a scene."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.reports.parts.figures import Fact
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import sigma_text
from calibrant.reports.parts.phrases import errors, transform_facts


def _answer(result: CalibrationResult) -> str:
    turns = result.transforms[0].sigma_rotation_deg if result.transforms else None
    return "" if turns is None else f"The rotation is known to {sigma_text(float(turns.max()))} deg (1σ)."


def _headline(result: CalibrationResult) -> list[Fact]:
    # The position is the camera's own by definition: it says nothing of how good the result is.
    turns = [fact for fact in transform_facts(result.transforms[:1]) if fact.name.endswith("rotation")]
    return [*turns, *errors(result, "pixel noise, 1σ")]


KIND = Kind("Rotation from vanishing points", _headline, _answer, said=("orthogonality", "focal-length"))
