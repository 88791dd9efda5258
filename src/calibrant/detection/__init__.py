"""Floor 3: find targets in images, one detector a target."""

from __future__ import annotations

from calibrant.detection.detection import Detection as Detection
from calibrant.detection.pipeline import detect as detect
