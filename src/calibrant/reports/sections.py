"""The parts of a result's page: the answer's figures, checks, views, residuals, coverage, what it was made from."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibrant.cameras import Camera
from calibrant.data import DEFAULT_CAMERA, CalibrationResult, Check, TransformEstimate
from calibrant.diagnose.look import Look
from calibrant.diagnose.loop import LoopView
from calibrant.reports.evidence import (
    histogram_blocks,
    influence_blocks,
    still_views,
    straight_blocks,
    uncertainty_blocks,
)
from calibrant.reports.kinds.comparison import compared_blocks
from calibrant.reports.kinds.registry import kind_of
from calibrant.reports.parts.blocks import Block
from calibrant.reports.parts.figures import (
    is_point,
    listed_figures,
    matrix_text,
    method_rows,
    quaternion_figures,
    translation_figures,
    yaw_pitch_roll_figures,
)
from calibrant.reports.parts.numbers import Figure, plain, sigma_text
from calibrant.reports.parts.phrases import OWN_OPTIONS
from calibrant.reports.parts.rows import view_rows
from calibrant.reports.reproduce import reproduced
from calibrant.reports.scene import scene
from calibrant.reports.view_data import page_views
from calibrant.reports.words import sorted_checks
from calibrant.reports.workspace import workspace_blocks

if TYPE_CHECKING:
    from calibrant.diagnose.look import CameraCoverage


_LISTED = 4
"""Views that a sentence names."""


@dataclass(frozen=True)
class Sections:
    """The blocks of a result's page, and the data of its scripts."""

    blocks: tuple[Block, ...]
    data: Mapping[str, Any] | None


@dataclass(frozen=True)
class Cell:
    """One cell of the coverage map: position and size in image pixels, its points, and its darkness 0 … 1."""

    x: float
    y: float
    width: float
    height: float
    points: int
    darkness: float


def sections(
    look: Look, *, images: Mapping[str, Path], beside: Sequence[CalibrationResult] = (), still: bool = False
) -> Sections:
    """All that a page says of a result below its head.

    Args: images, files by view id, in place of those it names; beside, comparisons with others; still, drawn without
    scripts.
    """
    result, kind = look.result, kind_of(look.result)
    compared = [block for other in beside for block in compared_blocks(other)]
    if kind.page is not None:
        return Sections((*kind.page(look), *compared, *_origins(result)), None)
    pages = page_views(result, look.residuals, look.loop, images=images)
    world = scene(look)
    rows = view_rows(result)
    out = {(row.camera, row.id) for row in rows if not row.used}
    checks = Block("checks", {"checks": sorted_checks(result)}) if result.checks else None
    # The answer first; of a result that is refused, why.
    answered = (_figures(result), checks)
    blocks: list[Block | None] = [
        *(answered if result.verdict != "refused" else reversed(answered)),
        *(table.block for table in kind.tables(result)),
        *compared,
        *kind.blocks(look),
        Block("workspace", {"workspaces": workspace_blocks(look)}) if look.workspaces else None,
        Block("methods", {"methods": method_rows(result)}) if result.methods else None,
        None if world is None else Block("scene", {"loop_sentence": _loop_sentence(look.loop, out), "still": still}),
        *(still_views(pages.views) if still else ()),
        Block("views", {"rows": rows, "rows_name": kind.rows, "result": result, "still": still})
        if pages.views
        else None,
        Block("residuals", {"picture_remark": pages.remark})
        if any(view["uv"] for view in pages.views) and not still
        else None,
        *histogram_blocks(look),
        _coverage(look),
        *uncertainty_blocks(look),
        *influence_blocks(look),
        *straight_blocks(look, dict(images)),
        *_origins(result),
    ]
    data = {"views": pages.views, "pictures": pages.pictures, "rms": result.rms_px, "scene": world}
    return Sections(tuple(block for block in blocks if block is not None), _finite(data))


def _figures(result: CalibrationResult) -> Block | None:
    facts = kind_of(result).facts(result)
    if not (result.transforms or result.cameras or facts):
        return None
    return Block(
        "result",
        {
            "transforms": [_transform_block(t) for t in result.transforms],
            "cameras": [_camera_block(name, camera) for name, camera in result.cameras.items()],
            "facts": facts,
        },
    )


def _coverage(look: Look) -> Block | None:
    result = look.result
    blocks = [_coverage_block(c, _remarks(result, c)) for c in look.coverage]
    return Block("coverage", {"coverage": blocks, "judged": result.is_about_cameras}) if blocks else None


def _origins(result: CalibrationResult) -> list[Block]:
    """What it was made from, and how to make it again."""
    return [_origin(result), reproduced(result).block]


def _origin(result: CalibrationResult) -> Block:
    asked = {name: _option_text(value) for name, value in result.options.items()}
    # "auto, decided: eye-in-hand" where the request left it open.
    decided = {
        OWN_OPTIONS.get(name, name): words if asked.get(name, words) == words else f"{asked[name]}, decided: {words}"
        for name, words in result.decided.items()
    }
    return Block("origin", {"result": result, "options": asked | decided})


def _camera_block(name: str, camera: Camera) -> dict[str, Any]:
    width, height = camera.image_size
    label = "Camera" if name == DEFAULT_CAMERA else f"Camera {name}"
    figures, others = listed_figures(camera)
    note = f"{camera.model.name}, {width} × {height} px" + (f"; {others}" if others else "")
    return {"heading": label, "note": note, "figures": figures}


def _transform_block(estimate: TransformEstimate) -> dict[str, Any]:
    groups: list[tuple[str, list[Figure]]] = [("position", translation_figures(estimate))]
    turns = None if is_point(estimate) else estimate.sigma_rotation_deg
    if not is_point(estimate):
        groups += [("yaw, pitch, roll", yaw_pitch_roll_figures(estimate)), ("quaternion", quaternion_figures(estimate))]
    return {
        "heading": f"{estimate.parent} → {estimate.child}",
        "name": f"T_{estimate.parent}_{estimate.child}",
        "parent": estimate.parent,
        "groups": groups,
        "matrix": "" if is_point(estimate) else matrix_text(estimate.matrix),
        "turns": None if turns is None else ", ".join(sigma_text(float(s)) for s in turns),
    }


def _remarks(result: CalibrationResult, views: CameraCoverage) -> list[Check]:
    """The checks beside the map, the result's own where it has them; of a given camera, those on residuals only.

    Of several cameras each has checks of its own, named after it: residual-structure-left."""
    own = {check.name: check for check in result.checks}
    wanted = [c for c in views.checks if result.is_about_cameras or c.name == "residual-structure"]
    return [own.get(f"{c.name}-{views.camera}", own.get(c.name, c)) for c in wanted]


def _coverage_block(views: CameraCoverage, remarks: list[Check]) -> dict[str, Any]:
    counts = views.coverage.counts
    rows, columns = counts.shape
    width, height = views.image_size
    w, h = width / columns, height / rows
    # Cells differ by orders of magnitude; the logarithm keeps a cell with one point apart from an empty one.
    most = math.log1p(max(int(counts.max()), 1))
    cells = [
        Cell(x * w, y * h, w, h, int(counts[y, x]), math.log1p(int(counts[y, x])) / most)
        for y in range(rows)
        for x in range(columns)
    ]
    return {
        "camera": views.camera,
        "width": width,
        "height": height,
        "cells": cells,
        "share": f"{100 * views.coverage.occupied:.0f}",
        "most": int(counts.max()),
        "remarks": remarks,
    }


def _option_text(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (list, tuple)):
        return ", ".join(_option_text(item) for item in value) or "none"
    if isinstance(value, Mapping):
        return ", ".join(f"{name}: {_option_text(item)}" for name, item in value.items()) or "none"
    if isinstance(value, float):
        return plain(value)
    return "none" if value is None else str(value)


def _loop_sentence(loop: tuple[LoopView, ...], out: Set[tuple[str, str]]) -> str:
    """How the loop closes over the views used; those left out, by camera and view, are told apart."""
    several = len({v.camera for v in loop}) > 1
    every = [
        (v.mm, v.deg, f"{v.camera} {v.view}" if several else v.view, (v.camera, v.view) in out)
        for v in loop
        if v.mm is not None and v.deg is not None
    ]
    steps = [step for step in every if not step[3]]
    if not steps:
        return ""
    apart = [f"{name} ({plain(mm, digits=2)} mm)" for mm, _, name, left in every if left]
    beside = (
        f" Left out, and drawn too: {', '.join(apart[:_LISTED])}{' …' if len(apart) > _LISTED else ''}."
        if apart
        else ""
    )
    mm = math.sqrt(sum(s[0] ** 2 for s in steps) / len(steps))
    deg = math.sqrt(sum(s[1] ** 2 for s in steps) / len(steps))
    worst = max(steps)
    return (
        f"The target by the camera and by the robot lie {plain(mm, digits=2)} mm and {plain(deg, digits=2)} deg apart "
        f"(RMS of {len(steps)} views used, at the target's centre); most at {worst[2]}: {plain(worst[0], digits=2)} mm."
        f"{beside}"
    )


def _finite(value: Any) -> Any:
    """The value with None for every number that JSON cannot carry."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
