"""The `calibrant` command: its subcommands, and one place where errors become messages and exit statuses.

0 done; 1 refused or failed its own checks, the reason on standard error; 2 unusable input or arguments; 130
interrupted.
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress

from calibrant.cli.command import Command, UsageError, nearest, parse
from calibrant.cli.help import command_help, group_help
from calibrant.cli.words import say_json, tell
from calibrant.errors import CalibrantError, CancelledError, RefusedError
from calibrant.tasks.registry import GROUPS, TASKS

ABOUT = "Calibrate cameras and robots, and prove it: from photos and robot poses to millimetres one can trust."
HELP = ("--help", "-h")
OPTIONS = (*HELP, "--version", "--install-completion")
ORDER = (
    *(
        "demo",
        "target",
        "detect",
        "capture",
        "intrinsics",
        "stereo",
        "rig",
        "projector",
        "project",
        "hand-eye",
        "hand-eye-point",
        "pose",
        "locate",
        "doctor",
    ),
    *("kinematics", "next-pose", "time-offset", "dynamic", "vanishing", "undistort", "rectify", "depth", "epipolar"),
    *("point", "scan", "report", "compare", "convert", "project", "verify", "servo", "tool", "ros", "study"),
)
"""How the list of commands is sorted: as a person meets them. All are in it."""
INTERRUPTED = "interrupted; no result was written"


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    given = list(sys.argv[1:] if arguments is None else arguments) or ["--help"]
    try:
        return _answered(given)
    except OSError as error:
        if error.filename is None:
            return _failed(error, given, 2, text=f"cannot write to standard output: {error.strerror or error}")
        return _failed(error, given, 1, text=_internal(error))
    except CancelledError as error:
        return _failed(error, given, error.exit_status, text=INTERRUPTED)
    except CalibrantError as error:
        return _failed(error, given, error.exit_status)
    except KeyboardInterrupt as error:
        # One that came while files were moved to their places says that they are there.
        return _failed(error, given, 130, text=str(error) if str(error).startswith("interrupted") else INTERRUPTED)
    except Exception as error:  # noqa: BLE001 - the last line of defence: a defect of ours, said so
        return _failed(error, given, 1, text=_internal(error))


def _answered(given: list[str]) -> int:
    """The answer to a command line: a command's work, or help."""
    name = " ".join(given[:2]) if " ".join(given[:2]) in TASKS else given[0]
    rest = given[len(name.split()) :]
    if name in TASKS:
        return _work(Command.of(name), rest)
    if name in GROUPS:
        if rest and rest[0] not in HELP:
            meant = nearest(rest[0], [command for command, _ in _listed(f"{name} ")])
            raise UsageError(f"No such command '{name} {rest[0]}'{meant}. See calibrant {name} --help.")
        sys.stdout.write(group_help(f"calibrant {name}", GROUPS[name], _listed(f"{name} ")))
        return 0
    if name in HELP:
        sys.stdout.write(group_help("calibrant", ABOUT, _listed("")))
        return 0
    if name == "--version":
        from calibrant.version import __version__

        sys.stdout.write(f"calibrant {__version__}\n")
        return 0
    if name == "--install-completion":
        from calibrant.cli.completion import install

        sys.stdout.write(install())
        return 0
    what = "option" if name.startswith("-") else "command"
    meant = nearest(name, OPTIONS if what == "option" else ORDER)
    raise UsageError(f"No such {what} '{name}'{meant}. See calibrant --help.")


def _listed(prefix: str) -> list[tuple[str, str]]:
    """The commands below a group and what each does; of all, groups stand for their commands."""
    if prefix:
        return [(name.removeprefix(prefix), entry.words) for name, entry in TASKS.items() if name.startswith(prefix)]
    single = {name: entry.words for name, entry in TASKS.items() if " " not in name}
    every = {**single, **GROUPS}
    return [(name, every[name]) for name in ORDER if name in every]


def _work(command: Command, arguments: Sequence[str]) -> int:
    """One command from its arguments to its files."""
    from calibrant.cli.finish import explained, finish
    from calibrant.cli.progress import listener
    from calibrant.tasks.registry import reads_of, run_task

    if any(word in HELP for word in arguments):
        sys.stdout.write(command_help(command))
        return 0
    try:
        call = parse(command, arguments)
    except UsageError as error:
        raise UsageError(f"{error}. See calibrant {command.name} --help.") from None
    call.places.check(force=call.outputs.force)
    call.places.spare(reads_of(command.task, call.request))
    try:
        outcome = run_task(command.task, call.request, listener(silent=call.outputs.silent))
    except RefusedError as error:
        raise explained(error, call) from error
    refusal = finish(outcome, call)
    if refusal is None:
        return 0
    # What --json prints is the result, which says that it is refused and why.
    _say(refusal, arguments)
    return refusal.exit_status


def _internal(error: Exception) -> str:
    return f"internal error: {type(error).__name__}: {error}. Run again with --debug and report it."


def _failed(error: BaseException, given: Sequence[str], status: int, *, text: str | None = None) -> int:
    """Say what went wrong, to people on standard error and, where they asked for it, to programs."""
    if "--json" in given:
        from calibrant.cli.failure import failure_json

        # A standard output that cannot be written to is what may have failed.
        with suppress(OSError, ValueError):
            say_json(failure_json(error, status, text if text is not None else str(error)))
            sys.stdout.flush()
    _say(error, given, text=text)
    return status


def _say(error: BaseException, given: Sequence[str], *, text: str | None = None) -> None:
    if "--debug" in given:
        tell("".join(traceback.format_exception(error)).rstrip())
    tell(f"calibrant: {text if text is not None else error}")
    for note in getattr(error, "__notes__", ()):
        tell(f"calibrant: note: {note}")
