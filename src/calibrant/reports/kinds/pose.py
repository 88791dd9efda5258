"""Results of `calibrant pose`: where a target is in the camera's frame."""

from __future__ import annotations

from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.phrases import first_transform, placed

KIND = Kind("Target pose", placed, first_transform, said=("weakest", "second-solution"))
