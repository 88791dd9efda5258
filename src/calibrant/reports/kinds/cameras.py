"""What another program's file holds: cameras, where they are, pictures with known places."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.reports.parts.figures import Fact
from calibrant.reports.parts.kind import Kind


def _headline(result: CalibrationResult) -> list[Fact]:
    counts = (("camera", result.cameras), ("transform", result.transforms), ("picture", result.views))
    return [Fact(f"{noun}s", str(len(found)), ", ".join(_names(found))) for noun, found in counts if len(found)]


def _names(found: object) -> list[str]:
    """At most four of them."""
    if isinstance(found, dict):
        names = list(found)
    else:
        names = [getattr(item, "id", "") or f"{item.parent} → {item.child}" for item in found]  # type: ignore[attr-defined]
    return names if len(names) <= 4 else [*names[:3], f"{len(names) - 3} more"]


KIND = Kind(
    "Cameras from a file",
    _headline,
    rows="pictures",
    verdicts={"ok": "READ", "warn": "READ, WITH WARNINGS", "refused": "NOT READ"},
)
