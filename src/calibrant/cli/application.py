"""The `calibrant` command: its subcommands, and one place where errors become messages and exit statuses.

0 done; 1 refused or failed its own checks, the reason on standard error; 2 unusable input or arguments.
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Iterable, Sequence
from importlib import import_module

import typer

from calibrant.errors import CalibrantError

COMMANDS = {
    "demo": "The whole chain on a simulated robot cell.",
    "target": "Print a board at true size.",
    "detect": "Find a board in photos.",
    "capture": "Take views from a running camera until it is known.",
    "intrinsics": "Calibrate a camera from photos of a board.",
    "hand-eye": "Find where the camera is, on a robot or beside it.",
    "pose": "Find where a target is, from photos.",
    "doctor": "Find what is wrong with hand-eye data, and repair it.",
    "kinematics": "Identify and correct a robot's geometry.",
    "next-pose": "Say which poses to take next, or from the start.",
    "time-offset": "Find the offset between camera's and robot's clocks.",
    "dynamic": "Locate a camera beside the robot through the wrist camera.",
    "vanishing": "Find how a camera is turned, from a scene's edges.",
    "undistort": "Undistort photos.",
    "report": "Show a result file, or make its HTML report.",
    "tool": "Find a tool's tip, by touch or by sight.",
    "study": "Compare methods, and see when each fails.",
}
"""Every command and what the list says of it: the function of that name in the module of that name, - as _."""
GROUPS = ("tool", "study")
"""Commands that have commands of their own: `app` in the module of that name."""

MANY_VALUES = (
    *("--images", "-i", "--poses", "--target-poses", "--exclude", "--fix"),
    *("--measurements", "-m", "--identify", "--hold"),
    *("--wrist-images", "--external-images"),
)
"""Options that take every value up to the next option, so that a shell's pattern (--images photos/*.png) works."""


def application(names: Iterable[str] = COMMANDS) -> typer.Typer:
    """The command line with these commands: Typer reads every option of each, which takes time for all of them."""
    app = typer.Typer(
        name="calibrant",
        help="Calibrate cameras and robots, and prove it: from photos and robot poses to millimetres one can trust.",
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_alone)
    for name in names:
        own = name.replace("-", "_")
        module = import_module(f"calibrant.cli.{own}")
        if name in GROUPS:
            app.add_typer(module.app, name=name, short_help=COMMANDS[name])
        else:
            app.command(name, short_help=COMMANDS[name])(getattr(module, own))
    return app


def _alone() -> None:
    """Without a callback, Typer would take one command alone for the whole program, its name for an argument."""


def spread(arguments: Sequence[str]) -> list[str]:
    """Repeat each of MANY_VALUES before every one of its values: --images a b -> --images a --images b.

    A word that can be no parameter's name ends --fix: `--fix k3 photos/*.jpg` names photos.
    """
    out: list[str] = []
    current: str | None = None
    values = 0
    for argument in arguments:
        if argument.startswith("-"):
            current, values = (argument if argument in MANY_VALUES else None), 0
            out.append(argument)
            continue
        if current == "--fix" and values and not argument.replace(",", "").isalnum():
            current = None
        if current is not None and values:
            out.append(current)
        values += 1
        out.append(argument)
    return out


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    given = list(sys.argv[1:] if arguments is None else arguments) or ["--help"]
    debug = "--debug" in given
    try:
        app = application([given[0]] if given[0] in COMMANDS else COMMANDS)
        status = app(spread(given), standalone_mode=False, prog_name="calibrant")
    except CalibrantError as error:
        return _failed(error, error.exit_status, debug)
    except typer.Exit as stop:
        return int(stop.exit_code)
    except (KeyboardInterrupt, typer.Abort):
        sys.stderr.write("calibrant: interrupted; nothing was written\n")
        return 130
    except Exception as error:  # noqa: BLE001 - the last line of defence: a defect of ours, said so
        usage = getattr(error, "format_message", None)
        if usage is not None:
            return _misused(error, usage(), given, debug)
        text = f"internal error: {type(error).__name__}: {error}. Run again with --debug and report it."
        return _failed(error, 1, debug, text=text)
    return int(status or 0)


def _misused(error: BaseException, message: str, given: Sequence[str], debug: bool) -> int:
    command = f"{given[0]} " if given[0] in COMMANDS and given[0] not in GROUPS else ""
    return _failed(error, 2, debug, text=f"{message.rstrip('.')}. See calibrant {command}--help.")


def _failed(error: BaseException, status: int, debug: bool, *, text: str | None = None) -> int:
    if debug:
        traceback.print_exception(error, file=sys.stderr)
    sys.stderr.write(f"calibrant: {text if text is not None else error}\n")
    return status
