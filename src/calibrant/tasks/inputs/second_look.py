"""The second look of every door at handheld boards: what cameras that are known help to find in their images."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.tasks.inputs.by_partner import numbered_by_partners

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult, Observations
    from calibrant.tasks.inputs.sources import Source


def looked_again(
    found: Mapping[str, Observations],
    result: CalibrationResult,
    *,
    sources: Mapping[str, Mapping[str, Source]],
    moments: Mapping[str, Mapping[Path, str]],
) -> Mapping[str, Observations]:
    """What cameras saw of every board, by its name, with the corners that the cameras help to find, and parts of
    chessboards that other cameras number; `found` itself where none was found.

    Args: result: the cameras of these observations; sources: by board and camera, how its images were searched;
    moments: by camera, what moment each image is of.
    """
    out = dict(found)
    for board, seen in found.items():
        for camera, source in sources[board].items():
            mine = seen.of_camera(camera)
            again = source.look_again(mine, result.cameras[camera])
            if again is not mine:
                others = tuple(v for v in out[board].views if v.camera != camera)
                out[board] = replace(out[board], views=(*others, *again.views))
        out[board] = numbered_by_partners(out[board], result, sources=sources[board], moments=moments)
    return found if all(out[board] is seen for board, seen in found.items()) else out
