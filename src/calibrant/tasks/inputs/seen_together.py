"""What each camera saw by itself, put together: under the cameras' names and the moments of their images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibrant.data import Observations


def of_camera(found: Observations, camera: str, moments: Mapping[Path, str]) -> Observations:
    """One camera's views under its name and their moments."""
    by_file = {str(file): moment for file, moment in moments.items()}
    size = next(iter(found.image_sizes.values()))
    views = tuple(replace(v, camera=camera, moment=by_file.get(v.file or "", v.id)) for v in found.views)
    missed = tuple(replace(m, camera=camera) for m in found.missed)
    notes = tuple(f"{camera}: {note}" for note in found.notes)
    return replace(found, views=views, image_sizes={camera: size}, missed=missed, notes=notes)


def together(parts: Sequence[Observations]) -> Observations:
    """What several cameras saw of one board."""
    from calibrant.data import Observations

    specs = {part.target for part in parts}
    return Observations(
        tuple(v for part in parts for v in part.views),
        {camera: size for part in parts for camera, size in part.image_sizes.items()},
        specs.pop() if len(specs) == 1 else None,
        tuple(m for part in parts for m in part.missed),
        tuple(note for part in parts for note in part.notes),
    )
