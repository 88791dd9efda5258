"""Floor 3: find targets in images, one detector a target."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

from calibrant.data import Observations
from calibrant.detect.detection import Detection as Detection
from calibrant.detect.pipeline import detect as detect


class _CallableModule(ModuleType):
    """`calibrant.detect` names this package and, as the public API promises, the function: calling it detects."""

    def __call__(self, *args: Any, **kwargs: Any) -> Observations:
        return detect(*args, **kwargs)


sys.modules[__name__].__class__ = _CallableModule
