"""When and by which version a result was made, and the refusal of one that failed its own checks."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

from calibrant.data import CalibrationResult
from calibrant.errors import RefusedError, causes


def stamp(result: CalibrationResult) -> CalibrationResult:
    """The result with the time (UTC) and the version that made it."""
    from calibrant.version import __version__

    return replace(result, created=datetime.now(UTC).isoformat(timespec="seconds"), version=__version__)


def refuse_if_failed(result: CalibrationResult) -> None:
    """Raises: RefusedError with the words of every failed check, and the result for whoever wants to look into it."""
    failed = [c for c in result.checks if c.status == "fail"]
    if failed:
        # That a fit does not end is what the others' causes do.
        failed.sort(key=lambda c: c.name == "convergence")
        error = RefusedError(causes(f"{c.name}: {c.message}" for c in failed))
        error.result = result
        raise error
