"""Pick up a cube and set it on another one: seen by colour and depth, nothing typed in but the cube's side."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated

from calibrant.errors import InputError
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.cell import CellOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.outcome import Outcome
from calibrant.tasks.verify.touch import refusal_of

EXAMPLE = 'cb.verify_pick_place(cell=True, view="top", seeds=1)'
MOST_CUBES = 1000


@dataclass(frozen=True, kw_only=True)
class Request:
    """Pick up a cube and set it on another one, ten times a cell; beside it, the thesis's two ways.

    calibrant verify pick-place --cell --view front --seeds 5
    calibrant verify pick-place --cell --view wrist --seeds 5 --beside none

    Cubes are found by colour and depth; where their middle is follows from their shape. Beside it run two versions of a
    thesis that take the middle of the coloured area as the cube, as it is and half a side farther. Each failure is told
    with its reason. It needs a robot that moves by itself: the simulated cell.
    """

    cubes: Annotated[int, Option("N")] = 10
    """Cubes a cell."""
    beside: Annotated[str, Option("WAYS", choices=("both", "none"))] = "both"
    """both: the thesis's two versions run with the same cubes; none: they do not."""
    yes: bool = False
    """Let a robot that could hit something move without asking."""
    cells: CellOptions = CellOptions()


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """How many cubes were set on the other, as a result of kind "pick-place". Raises: InputError."""
    from calibrant.tasks.verify.in_cell.pick_place import pick_place_series
    from calibrant.verification.pick_place.run import WAYS
    from calibrant.verification.runs import runs_text

    request.cells.check()
    if not request.cells.cell:
        raise InputError(
            "pick and place needs a robot that moves by itself: give --cell for the simulated one; from Python, "
            "calibrant.verification.pick_place.run takes any robot and camera that speak the protocols of "
            "calibrant.data"
        )
    if request.beside not in ("both", "none"):
        raise InputError(f"--beside is both or none, got {request.beside!r}")
    if not 1 <= request.cubes <= MOST_CUBES:
        raise InputError(f"--cubes {request.cubes}: 1 to {MOST_CUBES}")
    ways = WAYS if request.beside == "both" else WAYS[:1]
    result = pick_place_series(request.cells, cubes=request.cubes, ways=ways, yes=request.yes, listener=listener)
    return Outcome(result=result, printed=partial(runs_text, result), refusal=refusal_of(result, "pick-place"))
