"""Plans of `calibrant next-pose`: no calibration, but the poses to take and what each will bring."""

from __future__ import annotations

from math import degrees
from typing import TYPE_CHECKING

from calibrant.data import CalibrationResult
from calibrant.data.details import ViewPlan
from calibrant.reports.parts.blocks import Block, Column, TextTable
from calibrant.reports.parts.figures import Fact
from calibrant.reports.parts.kind import Kind

if TYPE_CHECKING:
    from rich.console import RenderableType

    from calibrant.diagnose.look import Look

UNDETERMINED_MM = 100.0
"""What is known to no better than this was not determined: before the first views nothing is known to 1 m."""
LIMITS_ALONE = "Only joint limits and view are checked; say what the arm must not hit with --geometry FILE."


def _known(mm: float) -> str:
    """A figure in millimetres, or a dash where the poses so far do not determine it."""
    return "–" if mm > UNDETERMINED_MM else f"{mm:.3g}"


def _state(plan: ViewPlan) -> str:
    now = _known(plan.before.sigma_mm)
    state = "nothing is known yet." if now == "–" else f"known to {now} mm (1σ, worst direction)."
    return f"{plan.asked}: {state}"


def _poses(plan: ViewPlan) -> TextTable:
    units = {name: "deg" if unit == "rad" else "mm" for name, unit in plan.units.items()}
    columns = (
        Column("pose", True),
        *(Column(f"q{i} {unit}", True) for i, unit in enumerate(units.values(), start=1)),
        Column("1σ after", True),
        Column("95 % below", True),
    )
    rows = tuple(
        (
            str(i),
            *(_joint(value, units[name]) for name, value in pose.joints.items()),
            f"{_known(pose.sigma_mm)} mm",
            f"{_known(pose.radius_95_mm)} mm",
        )
        for i, pose in enumerate(plan.poses, start=1)
    )
    return TextTable("Poses to take, in this order", columns, rows, "" if plan.obstacles else LIMITS_ALONE)


def _joint(value: float, unit: str) -> str:
    shown = degrees(value) if unit == "deg" else 1e3 * value
    return f"{shown:.0f}" if abs(shown) >= 100 else f"{shown:.1f}"


def _headline(result: CalibrationResult) -> list[Fact]:
    plan = result.detail(ViewPlan)
    if plan is None or not plan.poses:
        return []
    last = plan.poses[-1]
    return [
        Fact("poses", str(len(plan.poses))),
        Fact("known before, 1σ", f"{_known(plan.before.sigma_mm)} mm", plan.asked),
        Fact("known after, 1σ", f"{_known(last.sigma_mm)} mm", f"95 % below {_known(last.radius_95_mm)} mm"),
    ]


def _answer(result: CalibrationResult) -> str:
    plan = result.detail(ViewPlan)
    return "" if plan is None else _state(plan)


def _terminal(result: CalibrationResult) -> list[RenderableType]:
    from rich.table import Table
    from rich.text import Text

    plan = result.detail(ViewPlan)
    if plan is None:
        return [Text("The result holds no plan.")]
    given = _poses(plan)
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for column in given.columns:
        table.add_column(column.name, justify="right", no_wrap=column.name != "pose")
    for row in given.rows:
        table.add_row(*row)
    return [Text(_state(plan)), table, *([Text(given.note)] if given.note else [])]


def _page(look: Look) -> list[Block]:
    plan = look.result.detail(ViewPlan)
    return [] if plan is None else [_poses(plan).block]


KIND = Kind("The poses to take next", _headline, _answer, rows="poses", page=_page, terminal=_terminal)
