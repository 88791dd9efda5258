"""The report: one HTML file that opens anywhere, offline, with everything it shows inside it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from calibrant.cameras import Camera
from calibrant.data import DEFAULT_CAMERA, CalibrationResult, Check, TransformEstimate
from calibrant.data.result_file import write_text
from calibrant.diagnose.coverage import CameraCoverage, camera_coverage
from calibrant.diagnose.residuals import fitted_poses, view_residuals
from calibrant.reports.figures import (
    is_point,
    listed_figures,
    method_rows,
    noise_facts,
    quaternion_figures,
    rows_name,
    translation_figures,
    yaw_pitch_roll_figures,
)
from calibrant.reports.headline import headline
from calibrant.reports.loop import LoopView, loop_views
from calibrant.reports.numbers import Figure, plain, sigma_text
from calibrant.reports.robot import geometry
from calibrant.reports.scene import scene
from calibrant.reports.view_data import page_views
from calibrant.reports.words import STATUS_WORDS, VERDICT_WORDS, sorted_checks, title, verdict_sentence, view_rows
from calibrant.reports.workspace import workspace_blocks

_PACKAGE = "calibrant.reports"
_MARKS = {"ok": "✓", "warn": "!", "fail": "✕", "refused": "✕"}
"""A shape beside each status, so that it does not hang on colour."""


@dataclass(frozen=True)
class Cell:
    """One cell of the coverage map: position and size in image pixels, its points, and its darkness 0 … 1."""

    x: float
    y: float
    width: float
    height: float
    points: int
    darkness: float


def write_report(
    result: CalibrationResult,
    path: str | Path,
    *,
    images: Mapping[str, str | Path] | None = None,
    force: bool = False,
) -> Path:
    """Write the report of a result as one HTML file without links to anything outside it.

    Args: images, files by view id, where they are no longer at the place the observations name; force, whether an
    existing file may be replaced. Pictures that cannot be read are left out and the page says so.
    Raises: InputError when the path exists and `force` is False, or cannot be written; nothing is left half-written.
    """
    pictures = {view: Path(file) for view, file in (images or {}).items()}
    return write_text(render_report(result, images=pictures), path, force=force)


def render_report(result: CalibrationResult, *, images: Mapping[str, Path]) -> str:
    """The report's HTML. Args: images, files by view id, in place of those the observations name."""
    environment = Environment(
        loader=PackageLoader(_PACKAGE), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.globals.update(plain=plain, sigma_text=sigma_text, marks=_MARKS, status_words=STATUS_WORDS)
    poses = fitted_poses(result)
    residuals = view_residuals(result, poses) if result.observations is not None else ()
    loop = loop_views(result)
    pages = page_views(result, residuals, loop, images=images)
    world = scene(result, poses, loop)
    data = {"views": pages.views, "pictures": pages.pictures, "rms": result.rms_px, "scene": world}
    return environment.get_template("report.html.j2").render(
        result=result,
        title=title(result),
        verdict=VERDICT_WORDS[result.verdict],
        sentence=verdict_sentence(result),
        headline=headline(result),
        facts=noise_facts(result),
        checks=sorted_checks(result),
        cameras=[_camera_block(name, camera) for name, camera in result.cameras.items()],
        transforms=[_transform_block(t) for t in result.transforms],
        geometry=geometry(result),
        workspaces=workspace_blocks(result),
        methods=method_rows(result),
        rows=view_rows(result),
        rows_name=rows_name(result),
        coverage=[_coverage_block(c, _remarks(result, c)) for c in camera_coverage(result)],
        loop_sentence=_loop_sentence(loop),
        has_residuals=any(view["uv"] for view in pages.views),
        has_scene=world is not None,
        picture_remark=pages.remark,
        options={name: _option_text(value) for name, value in {**result.options, **result.decided}.items()},
        data=_finite(data),
        style=_asset("report.css"),
        scripts=[_asset("report.js"), _asset("scene.js")],
    )


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
        "turns": None if turns is None else ", ".join(sigma_text(float(s)) for s in turns),
    }


def _remarks(result: CalibrationResult, views: CameraCoverage) -> list[Check]:
    """The checks beside the map, the result's own where it has them; of a given camera, those on residuals only."""
    own = {check.name: check for check in result.checks}
    wanted = [c for c in views.checks if result.kind == "intrinsics" or c.name == "residual-structure"]
    return [own.get(check.name, check) for check in wanted]


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


def _loop_sentence(loop: tuple[LoopView, ...]) -> str:
    several = len({v.camera for v in loop}) > 1
    steps = [
        (v.mm, v.deg, f"{v.camera} {v.view}" if several else v.view)
        for v in loop
        if v.mm is not None and v.deg is not None
    ]
    if not steps:
        return ""
    mm = math.sqrt(sum(s[0] ** 2 for s in steps) / len(steps))
    deg = math.sqrt(sum(s[1] ** 2 for s in steps) / len(steps))
    worst = max(steps)
    return (
        f"The target by the camera and by the robot lie {plain(mm, digits=2)} mm and {plain(deg, digits=2)} deg apart "
        f"(RMS of {len(steps)} views, at the target's centre); most at {worst[2]}: {plain(worst[0], digits=2)} mm."
    )


def _asset(name: str) -> Markup:
    """A style sheet or script of this package: our own text, safe to embed as it stands."""
    text = resources.files(_PACKAGE).joinpath("templates", name).read_text(encoding="utf-8")
    return Markup(text)


def _finite(value: Any) -> Any:
    """The value with None for every number that JSON cannot carry."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
