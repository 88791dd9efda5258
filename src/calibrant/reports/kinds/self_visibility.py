"""Results of `calibrant tool self-visibility`: a hand camera by the gripper's features that it sees."""

from __future__ import annotations

from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.phrases import first_transform, placed

KIND = Kind("Hand camera by self-visibility", placed, first_transform)
