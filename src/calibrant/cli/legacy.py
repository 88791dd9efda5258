"""Commands that are not yet tasks: Typer reads their options. Each that becomes one leaves this file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib import import_module

import typer

from calibrant.cli.application import LEGACY

LEGACY_GROUPS: tuple[str, ...] = ()
"""Commands that have commands of their own: `app` in the module of that name."""

MANY_VALUES = (
    *("--images", "-i", "--poses", "--target-poses", "--exclude", "--fix"),
    *("--measurements", "-m", "--identify", "--hold"),
    *("--wrist-images", "--external-images"),
)
"""Options that take every value up to the next option, so that a shell's pattern (--images photos/*.png) works."""


def application(names: Iterable[str] = LEGACY) -> typer.Typer:
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
        if name in LEGACY_GROUPS:
            app.add_typer(module.app, name=name, short_help=LEGACY[name])
        else:
            app.command(name, short_help=LEGACY[name])(getattr(module, own))
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


def run_legacy(given: list[str]) -> int:
    """Run a command that is no task yet. Raises: UsageError."""
    from calibrant.cli.command import UsageError

    try:
        return int(application([given[0]])(spread(given), standalone_mode=False, prog_name="calibrant") or 0)
    except typer.Exit as stop:
        return int(stop.exit_code)
    except typer.Abort:
        raise KeyboardInterrupt from None
    except Exception as error:
        usage = getattr(error, "format_message", None)
        if usage is None:
            raise
        command = f"{given[0]} " if given[0] not in LEGACY_GROUPS else ""
        raise UsageError(f"{usage().rstrip('.')}. See calibrant {command}--help.") from None
