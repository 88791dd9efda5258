"""What the commands about projects print and give as JSON: poses in mm and degrees, stages with their reasons."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from calibrant.tasks.outcome import Answer, Outcome

if TYPE_CHECKING:
    from rich.console import RenderableType

    from calibrant.arrays import Array
    from calibrant.cameras import Camera
    from calibrant.formats.projects.frames import Place
    from calibrant.formats.projects.records import Project
    from calibrant.tasks.project.stages import Stage

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


def places_table(places: Sequence[Place], *, title: str = "") -> RenderableType:
    """Where components are: t in mm, yaw, pitch, roll (z-y'-x'') in degrees, 1 sigma below where it is known."""
    from rich.table import Table
    from rich.text import Text

    table = Table(title=Text(title) if title else None, title_justify="left", box=None, pad_edge=False)
    # Names are folded where the terminal is narrow, numbers never.
    for head in ("component", "in", "x, y, z (mm)", "yaw, pitch, roll (deg)", "from"):
        table.add_column(head, overflow="fold", no_wrap=head.endswith(")"))
    for p in places:
        named = Text(f"{p.name} ({p.kind})")
        if p.xyz_mm is None or p.ypr_deg is None:
            table.add_row(named, Text(p.relative_to), "", "", Text(p.source))
            continue
        table.add_row(
            named,
            Text(p.relative_to),
            _with_sigma(p.xyz_mm, p.sigma_mm, _DIGITS_MM),
            _with_sigma(p.ypr_deg, p.sigma_deg, _DIGITS_DEG),
            Text(p.source),
        )
    return table


def _with_sigma(values: Array, sigma: Array | None, digits: int) -> str:
    shown = ", ".join(f"{v + 0.0:.{digits}f}" for v in values)
    return shown if sigma is None else f"{shown}\n± {', '.join(f'{s:.2g}' for s in sigma)}"


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
