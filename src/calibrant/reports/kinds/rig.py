"""Results of several cameras that are fixed to each other."""

from __future__ import annotations

from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.phrases import focal_known, placed

KIND = Kind("Rig calibration", placed, focal_known)
