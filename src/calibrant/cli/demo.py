"""`calibrant demo`: the whole chain on a simulated robot cell, and its result beside the truth."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibrant.cli import options as o

if TYPE_CHECKING:
    from calibrant.tasks.demo import DemoOutcome


class SetupName(StrEnum):
    """Where the camera is."""

    EYE_IN_HAND = "eye-in-hand"
    EYE_TO_HAND = "eye-to-hand"


def demo(
    seed: Annotated[int, typer.Option(min=0, help="Which cell to simulate: mounting, views, noise.")] = 0,
    out: Annotated[Path, typer.Option(help="Folder to write; one that an earlier demo wrote is replaced.")] = Path(
        "calibrant-demo"
    ),
    views: Annotated[int, typer.Option(min=5, max=200, help="How many pictures the robot takes.")] = 20,
    setup: Annotated[
        SetupName, typer.Option(help="Camera on the gripper, or beside the robot.")
    ] = SetupName.EYE_IN_HAND,
    json: o.Json = False,
    quiet: o.Quiet = False,
    debug: o.Debug = False,
) -> int:
    """Calibrate a simulated robot cell, with no hardware and no files.

    calibrant demo [--seed N] [--out DIR] [--views N] [--setup eye-in-hand|eye-to-hand]

    A camera on a simulated UR5e photographs a ChArUco board; pictures and robot poses go to DIR. Then everything runs
    as on your own data: find the board, calibrate the camera, calibrate hand and eye, write results and report. At the
    end each figure stands beside its predicted uncertainty and beside the truth, which only a simulation knows.
    """
    from calibrant.cli.progress import listener
    from calibrant.data.result_encoding import format_json
    from calibrant.tasks.demo import result_json, run_demo

    outcome = run_demo(out, seed=seed, views=views, setup=setup.value, listener=listener(silent=quiet or json))
    if json:
        typer.echo(format_json(result_json(outcome)))
    elif not quiet:
        _print(outcome, out)
    return 1 if outcome.hand_eye.verdict == "refused" else 0


def _print(outcome: DemoOutcome, out: Path) -> None:
    """Summary of the result, the comparison, the files, and the command that repeats the calibration."""
    from rich.console import Console
    from rich.text import Text

    from calibrant.reports.terminal import summary
    from calibrant.tasks.demo import comparison

    console = Console()
    console.print(summary(outcome.hand_eye))
    console.print(Text())
    console.print(comparison(outcome))
    for name, path in outcome.files.items():
        console.print(Text(f"{name:<12} {path}"), soft_wrap=True)
    inputs = f"--images {out / 'images'} --poses {out / 'poses.csv'} --target {outcome.cell.target.spec}"
    repeat = f"calibrant hand-eye {inputs} --setup {outcome.cell.setup}"
    console.print(Text(f"\nThe same from the files alone:\n  {repeat}"), soft_wrap=True)
    console.print(Text(f"Took {sum(outcome.seconds.values()):.0f} s."))
