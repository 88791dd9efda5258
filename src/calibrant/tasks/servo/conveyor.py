"""Grasps on the move, in simulated cells: what a belt carries and that turns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

from calibrant.errors import InputError, RefusedError
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.outcome import Answer, Outcome
from calibrant.tasks.servo.run import MOST_SEEDS
from calibrant.tasks.servo.teach import degrees

if TYPE_CHECKING:
    from calibrant.studies.conveyor_cell import Passed

EXAMPLE = 'cb.servo_conveyor(cell=True, seeds=1, speed="200mm")'
FASTEST_M_S = 0.5


@dataclass(frozen=True, kw_only=True)
class Request:
    """Grasp what a belt carries, on the move, in simulated cells.

    calibrant servo conveyor --cell --seeds 10 --trials 10 --json

    The wrist camera is calibrated from pictures, finds the cube by its outline, a filter follows it, and the fingers
    close while the arm goes on with it. Exit status 1 where one was not held. A real robot is led from Python:
    calibrant.servoing.conveyor.grasp.
    """

    cell: bool = False
    """Try it in simulated cells."""
    seeds: Annotated[int, Option("N")] = 1
    """Cells to try."""
    seed: Annotated[int, Option("N")] = 0
    """The first cell's number."""
    trials: Annotated[int, Option("N")] = 1
    """Grasps in each cell."""
    speed: Annotated[str, Option("LENGTH")] = "200mm"
    """The belt's fastest, a second: speeds are drawn from 0 to it."""
    turn: Annotated[str, Option("ANGLE")] = "30deg"
    """The cube's fastest turn to either side, a second."""


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The grasps, as a table. Raises: InputError; MissingExtraError without the extra sim."""
    if not request.cell:
        raise InputError(
            "servo conveyor grasps in simulated cells: give --cell; a real one is led from Python (docs/servoing.md)"
        )
    for option, count in (("--seeds", request.seeds), ("--trials", request.trials)):
        if not 1 <= count <= MOST_SEEDS:
            raise InputError(f"{option} {count}: 1 to {MOST_SEEDS}")
    from calibrant.studies.conveyor_cell import conveyor_json, conveyor_study
    from calibrant.targets.lengths import parse_length

    fastest, turn = parse_length(request.speed, what="--speed"), degrees(request.turn, option="--turn")
    if fastest > FASTEST_M_S or not 0 <= turn <= 90:
        raise InputError(f"belts run at up to {1e3 * FASTEST_M_S:g} mm a second here, and cubes turn by 0 to 90 deg")
    with listener.progress("Grasping") as step:
        runs = conveyor_study(
            range(request.seed, request.seed + request.seeds), trials=request.trials, fastest=fastest,
            turns_deg_s=turn, step=step,
        )  # fmt: skip
    missed = sum(not r.held for r in runs)
    refusal = RefusedError(f"{missed} of {len(runs)} grasps did not hold the cube") if missed else None
    return Outcome(answer=Answer(runs, partial(conveyor_json, runs)), summary=partial(table, runs), refusal=refusal)


def table(runs: tuple[Passed, ...]) -> Any:
    """For a terminal."""
    from calibrant.reports.parts.blocks import Column, TextTable
    from calibrant.reports.terminal import text_table

    names = ("seed", "trial", "belt [m/s]", "turn [deg/s]", "off [mm]", "sights", "time [s]", "")
    rows = tuple(
        (str(r.seed), str(r.trial), f"{r.speed_m_s:.3f}", f"{r.turn_deg_s:.0f}", f"{r.off_mm:.1f}", str(r.sights),
         f"{r.seconds:.1f}", "held" if r.held else r.reason)
        for r in runs
    )  # fmt: skip
    columns = tuple(Column(name, k < len(names) - 1) for k, name in enumerate(names))
    note = f"{sum(r.held for r in runs)} of {len(runs)} held, by the truth after the lift."
    return text_table(TextTable("Grasps on the move", columns, rows, note=note))
