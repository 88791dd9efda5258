"""The `calibrant` command: its subcommands, and one place where errors become messages and exit statuses.

0 done; 1 refused or failed its own checks, the reason on standard error; 2 unusable input or arguments.
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Sequence

import typer

from calibrant.cli import demo, hand_eye, intrinsics
from calibrant.errors import CalibrantError

app = typer.Typer(
    name="calibrant",
    help="Calibrate cameras and robots, and prove it: from photos and robot poses to millimetres one can trust.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("demo")(demo.demo)
app.command("intrinsics")(intrinsics.intrinsics)
app.command("hand-eye")(hand_eye.hand_eye)

MANY_VALUES = ("--images", "--poses", "--target-poses", "--exclude", "--fix")
"""Options that take every value up to the next option, so that a shell's pattern (--images photos/*.png) works."""


def spread(arguments: Sequence[str]) -> list[str]:
    """Repeat each of MANY_VALUES before every one of its values: --images a b -> --images a --images b."""
    out: list[str] = []
    current: str | None = None
    values = 0
    for argument in arguments:
        if argument.startswith("-"):
            current, values = (argument if argument in MANY_VALUES else None), 0
            out.append(argument)
            continue
        if current is not None and values:
            out.append(current)
        values += 1
        out.append(argument)
    return out


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in given
    try:
        status = app(spread(given), standalone_mode=False)
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
            return _failed(error, 2, debug, text=f"{usage()} See calibrant {' '.join(given[:1])} --help.")
        return _failed(error, 1, debug, text=f"internal error: {type(error).__name__}: {error}. Run again with --debug and report it.")
    return int(status or 0)


def _failed(error: BaseException, status: int, debug: bool, *, text: str | None = None) -> int:
    if debug:
        traceback.print_exception(error, file=sys.stderr)
    sys.stderr.write(f"calibrant: {text if text is not None else error}\n")
    return status
