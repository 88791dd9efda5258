"""The `calibrant` command: its subcommands, and one place where errors become messages and exit statuses.

0 done; 1 refused or failed its own checks, the reason on standard error; 2 unusable input or arguments.
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Sequence

import typer

from calibrant.cli import (
    capture,
    demo,
    detect,
    doctor,
    dynamic,
    hand_eye,
    intrinsics,
    kinematics,
    next_pose,
    pose,
    report,
    study,
    target,
    time_offset,
    tool,
    undistort,
    vanishing,
)
from calibrant.errors import CalibrantError

app = typer.Typer(
    name="calibrant",
    help="Calibrate cameras and robots, and prove it: from photos and robot poses to millimetres one can trust.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("demo", short_help="The whole chain on a simulated robot cell.")(demo.demo)
app.command("target", short_help="Print a board at true size.")(target.target)
app.command("detect", short_help="Find a board in photos.")(detect.detect)
app.command("capture", short_help="Take views from a running camera until it is known.")(capture.capture)
app.command("intrinsics", short_help="Calibrate a camera from photos of a board.")(intrinsics.intrinsics)
app.command("hand-eye", short_help="Find where the camera is, on a robot or beside it.")(hand_eye.hand_eye)
app.command("pose", short_help="Find where a target is, from photos.")(pose.pose)
app.command("doctor", short_help="Find what is wrong with hand-eye data, and repair it.")(doctor.doctor)
app.command("kinematics", short_help="Identify and correct a robot's geometry.")(kinematics.kinematics)
app.command("next-pose", short_help="Say which poses to take next, or from the start.")(next_pose.next_pose)
app.command("time-offset", short_help="Find the offset between camera's and robot's clocks.")(time_offset.time_offset)
app.command("dynamic", short_help="Locate a camera beside the robot through the wrist camera.")(dynamic.dynamic)
app.command("vanishing", short_help="Find how a camera is turned, from a scene's edges.")(vanishing.vanishing)
app.add_typer(tool.app, name="tool", short_help="Find a tool's tip, by touch or by sight.")
app.command("undistort", short_help="Undistort photos.")(undistort.undistort)
app.add_typer(study.app, name="study", short_help="Compare methods, and see when each fails.")
app.command("report", short_help="Show a result file, or make its HTML report.")(report.report)

MANY_VALUES = (
    *("--images", "-i", "--poses", "--target-poses", "--exclude", "--fix"),
    *("--measurements", "-m", "--identify", "--hold"),
    *("--wrist-images", "--external-images"),
)
"""Options that take every value up to the next option, so that a shell's pattern (--images photos/*.png) works."""


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
    command = next((f"{c.name} " for c in app.registered_commands if c.name == given[0]), "")
    return _failed(error, 2, debug, text=f"{message.rstrip('.')}. See calibrant {command}--help.")


def _failed(error: BaseException, status: int, debug: bool, *, text: str | None = None) -> int:
    if debug:
        traceback.print_exception(error, file=sys.stderr)
    sys.stderr.write(f"calibrant: {text if text is not None else error}\n")
    return status
