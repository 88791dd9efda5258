"""Options of commands that run in the simulated robot cell."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.options.option import Option

if TYPE_CHECKING:
    from calibrant.simulate.robot_cell.cell import RobotCell
    from calibrant.simulate.robot_cell.parts.spec import RobotCellSpec

VIEWS = ("wrist", "front", "top")


@dataclass(frozen=True, kw_only=True)
class CellOptions:
    """A simulated cell in place of a robot and cameras, drawn anew for every seed."""

    cell: bool = False
    """Run in the simulated robot cell (extra `sim`): no hardware, no files."""
    seeds: Annotated[int, Option("N")] = 20
    """Cells to run in: seeds FIRST to FIRST + N - 1."""
    first_seed: Annotated[int, Option("FIRST")] = 0
    """The first of them."""
    view: Annotated[str, Option("CAMERA", choices=VIEWS)] = "wrist"
    """Which camera looks: wrist, front or top."""
    arm: Annotated[str, Option("ARM", choices=("panda", "ur5e"))] = "panda"
    """The cell's arm: panda, ur5e, ur3e, ur10e, or a file (MJCF, URDF)."""
    record: Annotated[Path | None, Option("DIR", output="folder")] = None
    """Keep every picture and a film (MP4, GIF) of each run here, a folder a seed."""
    show: bool = False
    """Open a window on the cell while it runs; needs a screen."""

    def check(self) -> None:
        """Raises: InputError for a view that is none, no seeds, or options of a cell without --cell."""
        if self.view not in VIEWS:
            raise InputError(f"--view is {', '.join(VIEWS[:-1])} or {VIEWS[-1]}, got {self.view!r}")
        if self.seeds < 1 or self.first_seed < 0:
            raise InputError(f"--seeds {self.seeds} --first-seed {self.first_seed}: take 1 or more, from 0 on")
        if not self.cell and (self.record is not None or self.show):
            raise InputError("--record and --show are of the simulated cell: give --cell too")

    @property
    def runs(self) -> range:
        """The seeds."""
        return range(self.first_seed, self.first_seed + self.seeds)

    def opened(self, seed: int, *, spec: RobotCellSpec | None = None) -> RobotCell:
        """The cell of one seed, with the arm asked for; recorded and shown where that is asked for.

        spec: what is in it otherwise. Raises: as `make_robot_cell`; InputError for --show without a screen.
        """
        from dataclasses import replace

        from calibrant.simulate.robot_cell import RobotCellSpec, make_robot_cell

        chosen = replace(spec or RobotCellSpec(), arm=self.arm)
        folder = None if self.record is None else self.record / f"seed-{seed:04d}"
        cell = make_robot_cell(seed, spec=chosen, record=folder)
        if self.show:
            cell.show()
        return cell
