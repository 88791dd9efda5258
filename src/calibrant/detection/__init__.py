"""Floor 4: find targets in images, one detector a target. Its two names load what they need on first use."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calibrant.detection.detection import Detection as Detection
    from calibrant.detection.pipeline import detect as detect

_HOME = {"Detection": "calibrant.detection.detection", "detect": "calibrant.detection.pipeline"}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'calibrant.detection' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
