"""Options that say what is known of the camera."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from calibrant.tasks.options.choices import MODELS
from calibrant.tasks.options.option import Option


@dataclass(frozen=True, kw_only=True)
class LensOptions:
    """The camera that is calibrated."""

    model: Annotated[str, Option("NAME", choices=MODELS)] = "brown"
    """Camera model: pinhole, pinhole_skew, brown, rational, thin_prism, tilted, inverse_brown, division,
    kannala_brandt, unified, extended_unified, double_sphere, orthographic, splined (or splined:16x12:120deg), or auto:
    chosen by held-out photos."""
    fix: Annotated[tuple[str, ...], Option("NAMES", names=True)] = ()
    """Hold these: fx fy cx cy k1 k2 k3 p1 p2, aspect, radial, tangential, focal, principal."""


@dataclass(frozen=True, kw_only=True)
class KnownCameraOptions:
    """The camera that took the photos, where it is known."""

    camera: Annotated[Path | None, Option("FILE")] = None
    """Known camera (any format); without it the photos calibrate it."""
