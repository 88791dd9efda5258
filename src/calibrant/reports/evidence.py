"""What a page draws beside the figures: noise against its model, the lens over the image, each view's influence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite, isnan
from pathlib import Path
from typing import Any

import numpy as np

from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.diagnose.budget.image import GRID, image_uncertainty, working_distance
from calibrant.diagnose.influence import ViewInfluence
from calibrant.diagnose.look import Look
from calibrant.diagnose.noise_histogram import NoiseHistogram, noise_histograms
from calibrant.percent import percent
from calibrant.reports.parts.blocks import Block, Column, TextTable, bars
from calibrant.reports.parts.maps import ImageMap, maps_block
from calibrant.reports.parts.numbers import plain
from calibrant.reports.parts.pictures import beside_block

_WIDTH, _HEIGHT, _FOOT, _TOP = 640.0, 220.0, 24.0, 8.0
"""Of a histogram, in units of its own."""
_MOST_LISTED = 8
"""Views in the table of those that move the result most."""


def histogram_blocks(look: Look) -> list[Block]:
    """Residuals of the used points beside the noise that is stated, camera by camera."""
    left_out = {(look.result.camera_of(v), v.id): v.points_left_out for v in look.result.views}
    kept = []
    for view in look.residuals:
        if view.used:
            order = np.argsort(np.linalg.norm(view.residuals, axis=-1), kind="stable")
            count = max(len(order) - left_out.get((view.camera, view.id), 0), 0)
            kept.append((view.camera, view.residuals[order[:count]]))
    found = noise_histograms(look.result, kept)
    return [Block("histogram", {"histograms": [_histogram(h, several=len(found) > 1) for h in found]})] if found else []


def _histogram(h: NoiseHistogram, *, several: bool) -> dict[str, object]:
    most = max(float(h.counts.max()), float(h.expected.max()), 1.0)
    scale, wide = (_HEIGHT - _FOOT - _TOP) / most, _WIDTH / len(h.counts)
    foot = _HEIGHT - _FOOT
    drawn = [
        {"x": i * wide, "y": foot - n * scale, "width": 0.94 * wide, "height": n * scale, "text": f"{n:.0f}"}
        for i, n in enumerate(h.counts)
    ]
    line = " ".join(f"{(i + 0.5) * wide:.1f},{foot - n * scale:.1f}" for i, n in enumerate(h.expected))
    ticks = [{"x": (k + 5) / 10 * _WIDTH, "text": f"{plain(k * h.sigma_px, digits=2)}"} for k in (-4, -2, 0, 2, 4)]
    return {
        "camera": h.camera if several else "",
        "bars": drawn,
        "line": line,
        "ticks": ticks,
        "width": _WIDTH,
        "height": _HEIGHT,
        "foot": foot,
        "words": (
            f"{h.total} residuals, both axes, px; the line is noise of {plain(h.sigma_px, digits=3)} px per axis. "
            f"Beyond 3σ lie {percent(h.far)}; such noise puts {percent(h.far_expected)} there."
        ),
    }


def uncertainty_blocks(look: Look) -> list[Block]:
    """How well each lens is known over its image: in pixels, and in mm where its targets stood."""
    maps = []
    for name, camera in look.result.cameras.items():
        if camera.covariance is None or not np.any(camera.covariance) or camera.model.projection == "parallel":
            continue
        maps += _uncertainty(look, name, camera)
    words = (
        "How far off a point that is known in the camera's frame appears by the lens alone, 1σ along the worst axis, "
        "and the same across a plane at the distance of the boards."
    )
    return [maps_block("How well the lens is known over the image", words, maps)] if maps else []


def _uncertainty(look: Look, name: str, camera: Camera) -> list[ImageMap]:
    tail = f", {name}" if len(look.result.cameras) > 1 else ""
    distance = working_distance(T for (camera_name, _), T in look.poses.items() if camera_name == name)
    found = image_uncertainty(camera, distance_m=distance or 1.0)
    place = "" if distance else " No board tells where it works: 1 m was taken."
    maps = [ImageMap(f"1σ, px{tail}", found.image_size, *GRID, _known(found.sigma_px), "px")]
    at = f"1σ, mm at {plain(found.distance_m, digits=3)} m{tail}"
    return [*maps, ImageMap(at, found.image_size, *GRID, _known(found.sigma_mm), "mm", place)]


def _known(values: np.ndarray) -> list[float | None]:
    return [None if isnan(v) else float(v) for v in values]


def influence_blocks(look: Look) -> list[Block]:
    """What leaving each view out would move."""
    found = look.influence
    if not found:
        return []
    table = _influence_table(found)
    series: dict[str, list[float | None]] = {
        "1σ of the result": [v.sigmas if isfinite(v.sigmas) else None for v in found]
    }
    drawn = bars("Influence of each view", "σ", [v.view for v in found], series)
    return [*([] if drawn is None else [drawn]), table.block]


def _influence_table(found: tuple[ViewInfluence, ...]) -> TextTable:
    of_lens = found[0].mm is None
    moved = (Column("over the image, px", True),) if of_lens else (Column("mm", True), Column("deg", True))
    order = sorted(found, key=lambda v: -v.sigmas)[:_MOST_LISTED]
    rows = tuple(
        (v.view, *(_moved(x) for x in ((v.px,) if of_lens else (v.mm, v.deg))), _sigmas(v.sigmas)) for v in order
    )
    what = "the lens, a rotation apart" if of_lens else "the camera's place, the lens held"
    note = (
        f"How far {what} would move with the view left out, from the linearised problem; in 1σ, the unknown that moves "
        "most. No calibration was run again."
    )
    return TextTable("Views that move the result most", (Column("without"), *moved, Column("in 1σ", True)), rows, note)


def _moved(value: float | None) -> str:
    return "–" if value is None else plain(value, digits=2)


def _sigmas(value: float) -> str:
    return plain(value, digits=2) if isfinite(value) else "undetermined"


def straight_blocks(look: Look, images: dict[str, Path]) -> list[Block]:
    """A picture of each camera as it was taken, and without its distortion beside it; the first that can be read."""
    from calibrant.errors import InputError

    views = look.result.observations.views if look.result.observations else ()
    pairs = []
    for name, camera in look.result.cameras.items():
        for view in (v for v in views if v.camera == name and (v.id in images or v.file)):
            try:
                pairs.append(
                    (name, view.id, *_straight(look.result, camera, images.get(view.id) or Path(view.file or "")))
                )
            except InputError:
                continue
            break
    return [beside_block("Without the lens's distortion", pairs)] if pairs else []


def _straight(result: CalibrationResult, camera: Camera, file: Path) -> tuple[np.ndarray, np.ndarray]:
    """The picture (h, w) as small as it is shown, and as a pinhole of its scale at the axis would have it."""
    from calibrant.detection.images.images import load_grey
    from calibrant.perceive.output_cameras import axis_camera
    from calibrant.perceive.undistort import undistortion

    image = np.asarray(load_grey(file), dtype=np.uint8)
    if result.options.get("mirror_x", False) is True:
        image = np.ascontiguousarray(image[:, ::-1])
    width, height = camera.image_size
    scale = min(1.0, _SHOWN / width)
    small = (max(1, round(width * scale)), max(1, round(height * scale)))
    return image, undistortion(camera, axis_camera(camera, image_size=small)).apply(image)


def still_views(views: Sequence[Mapping[str, Any]]) -> list[Block]:
    """The errors of the views as a picture that needs no script."""
    series = {f"RMS, {unit}": [v[key] for v in views] for key, unit in (("rms", "px"), ("mm", "mm"))}
    drawn = {what: row for what, row in series.items() if any(value is not None for value in row)}
    found = [
        bars(f"Error of each view, {unit[-2:]}", unit[-2:], [v["id"] for v in views], {unit: row})
        for unit, row in drawn.items()
    ]
    return [block for block in found if block is not None]


_SHOWN = 720
"""Width of a picture, pixels."""
