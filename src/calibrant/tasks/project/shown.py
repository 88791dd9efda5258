"""What the commands about projects print and give as JSON: poses in mm and degrees, stages with their reasons."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from calibrant.tasks.outcome import Answer, Outcome

if TYPE_CHECKING:
    from rich.console import RenderableType

    from calibrant.cameras import Camera
    from calibrant.formats.projects.frames import Place
    from calibrant.formats.projects.records import Project
    from calibrant.tasks.project.solution.stages import Stage

_DIGITS_MM, _DIGITS_DEG = 3, 4


def changed(project: Project, *words: str) -> Outcome:
    """The outcome of a command that changed a project: the project, and what was done in words."""
    return Outcome(answer=Answer(project, partial(project_json, project)), summary=partial(lines, *words))


def lines(*words: str) -> RenderableType:
    """Plain lines: names are shown as they are, whatever is in them."""
    from rich.text import Text

    return Text("\n".join(words))


def project_json(project: Project) -> str:
    """A project as JSON, as its file has it."""
    from calibrant.data.typed_json import as_json

    return json.dumps(as_json(project), ensure_ascii=False, indent=1)


def places_table(places: Sequence[Place]) -> RenderableType:
    """Where components are: t in mm, yaw, pitch, roll (z-y'-x'') in degrees, 1 sigma below where it is known."""
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False)
    # Names are folded where the terminal is narrow, numbers never.
    table.add_column("component", overflow="fold")
    for head in ("x, y, z (mm)", "yaw, pitch, roll (deg)"):
        table.add_column(head, no_wrap=True)
    for p in places:
        table.add_row(Text(f"{p.name} ({p.kind})"), *_figures(p))
        where = p.source if p.T is None or p.name == p.relative_to else f"in {p.relative_to}, {p.source}"
        table.add_row(Text(f"  {where}"), *_sigmas(p))
    return table


def _figures(p: Place) -> tuple[str, ...]:
    if p.xyz_mm is None or p.ypr_deg is None:
        return ()
    return tuple(
        ", ".join(f"{v + 0.0:.{digits}f}" for v in values)
        for values, digits in ((p.xyz_mm, _DIGITS_MM), (p.ypr_deg, _DIGITS_DEG))
    )


def _sigmas(p: Place) -> tuple[str, ...]:
    """1 sigma of each figure; of yaw and roll at pitch 90 degrees, which cannot be told apart, none."""
    if p.T is None or p.sigma_mm is None:
        return ()
    from calibrant.data.results import TransformEstimate
    from calibrant.reports.parts.figures import yaw_pitch_roll_figures
    from calibrant.reports.parts.numbers import sigma_text

    turned = yaw_pitch_roll_figures(TransformEstimate(p.relative_to, p.name, p.T, p.covariance))
    sigmas = ([*p.sigma_mm.tolist()], [figure.sigma for figure in turned])
    return tuple(f"± {', '.join(sigma_text(v) or '–' for v in values)}" for values in sigmas)


def places_as_json(places: Sequence[Place]) -> list[dict[str, Any]]:
    """The same as plain values; sigmas only where they are known, rotation sigmas about the axes of the frame."""
    out = []
    for p in places:
        entry: dict[str, Any] = {"name": p.name, "kind": p.kind, "relative_to": p.relative_to, "source": p.source}
        for key, value in (
            ("xyz_mm", p.xyz_mm),
            ("ypr_deg", p.ypr_deg),
            ("matrix", p.T),
            ("sigma_mm", p.sigma_mm),
            ("sigma_rotation_deg", p.sigma_deg),
        ):
            if value is not None:
                entry[key] = value.tolist()
        out.append(entry)
    return out


def lens_lines(lenses: dict[str, Camera]) -> list[str]:
    """fx fy cx cy and what else is not zero, with sigma where it is known."""
    return [f"{name}: {camera.model.name}, {_parameters(camera)}" for name, camera in lenses.items()]


def _parameters(camera: Camera) -> str:
    shown = {n: v for n, v in camera.parameters.items() if v or n in ("fx", "fy", "cx", "cy")}
    return ", ".join(f"{n} {v:.6g}{_plus_minus(camera, n)}" for n, v in shown.items())


def _plus_minus(camera: Camera, name: str) -> str:
    sigma = camera.sigma.get(name) if camera.covariance is not None else None
    return f" ± {sigma:.2g}" if sigma else ""


def stage_lines(stages: Sequence[Stage]) -> list[str]:
    """A line a stage: what it is, its state, why."""
    return [f"{s.words}: {s.state}{f' ({s.why})' if s.why else ''}" for s in stages]


def stages_as_json(stages: Sequence[Stage]) -> list[dict[str, Any]]:
    """The same as plain values."""
    return [{"of": s.of, "name": s.name, "covers": list(s.covers), "state": s.state, "why": s.why} for s in stages]
