"""A command line read into a task's Request: cyclopts parses, the Request says what there is to parse."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from calibrant.cli.outputs import OutputOptions, Places, output_fields, places_of
from calibrant.errors import InputError
from calibrant.tasks.options.fields import Field, build, spread
from calibrant.tasks.registry import TASKS, Entry, Task

if TYPE_CHECKING:
    from cyclopts import App

_NEGATIVE = re.compile(r"-[.]?\d")


class UsageError(InputError):
    """Arguments that the command does not have, or that it misses."""


@dataclass(frozen=True)
class Command:
    """A command with its task loaded."""

    name: str
    entry: Entry
    task: Task

    @classmethod
    def of(cls, name: str) -> Command:
        """The command of that name in the registry."""
        return cls(name, TASKS[name], TASKS[name].load())

    @property
    def fields(self) -> tuple[Field, ...]:
        """Every option: the Request's, then where results go."""
        return (*spread(self.task.Request), *output_fields(self.entry))

    @property
    def flags(self) -> set[str]:
        """The options' names on the command line, long and short."""
        named = [f for f in self.fields if not f.option.positional]
        return {flag for f in named for flag in (f.flag, f.option.short) if flag} | {"--help", "-h"}


@dataclass(frozen=True)
class Call:
    """What a person asked for, and the words it was asked in."""

    command: Command
    arguments: tuple[str, ...]
    request: Any
    outputs: OutputOptions
    places: Places


def parse(command: Command, arguments: Sequence[str]) -> Call:
    """The request on a command line. Raises: UsageError for arguments that are none of the command's."""
    # Before the parser, which says of a missing argument first what a misspelt option did not give it.
    for word in arguments:
        flag = word.partition("=")[0]
        if flag.startswith("--") and flag != "--" and flag not in command.flags:
            raise UsageError(f"No such option: {flag}{nearest(flag, command.flags)}")
    from cyclopts import CycloptsError

    try:
        values = _app_of(command)(
            ended_names(command.fields, arguments), exit_on_error=False, print_error=False, help_on_error=False
        )
    except CycloptsError as error:
        raise UsageError(_misuse(error, command)) from None
    request = build(command.task.Request, values)
    places = places_of(command.fields, values, getattr(command.task, "BESIDE", None))
    # A task's own --out, a page or a folder, is no place for its result.
    skins = {field.name: values[field.name] for field in output_fields(command.entry) if field.name in values}
    return Call(command, tuple(arguments), request, build(OutputOptions, skins), places)


def _app_of(command: Command) -> App:
    """A parser of the command's arguments that gives their values by name."""
    from cyclopts import App

    app = App(name=f"calibrant {command.name}", help_flags=(), version_flags=(), result_action="return_value")
    app.default(collector(command))
    return app


def collector(command: Command) -> Any:
    """A function with the command's options for a signature, that gives back what it is called with."""

    def collected(*positional: str, **values: Any) -> dict[str, Any]:
        given = iter(positional)
        taken = {f.name: tuple(given) if f.many else next(given, f.default) for f in first if f.many or positional}
        return {**values, **taken}

    first = [f for f in command.fields if f.option.positional]
    parameters = [_parameter(field) for field in sorted(command.fields, key=lambda f: not f.option.positional)]
    collected.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    collected.__annotations__ = {p.name: p.annotation for p in parameters}
    collected.__doc__ = inspect.getdoc(command.task.Request)
    return collected


def _parameter(field: Field) -> inspect.Parameter:
    """An option as cyclopts takes it."""
    from cyclopts import Parameter

    if field.option.positional:
        said = Parameter(name=field.option.metavar or field.name, help=field.help, required=field.required)
        kind = inspect.Parameter.VAR_POSITIONAL if field.many else inspect.Parameter.POSITIONAL_ONLY
        default = inspect.Parameter.empty if field.required or field.many else field.default
        kept = str if field.many else field.inner
        return inspect.Parameter(field.name, kind, default=default, annotation=Annotated[kept, said])
    said = Parameter(
        name=(field.flag, field.option.short) if field.option.short else field.flag,
        help=field.help,
        negative=(),
        consume_multiple=field.many or None,
        allow_repeating=True,
    )
    default = inspect.Parameter.empty if field.required else field.default
    return inspect.Parameter(
        field.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[field.kind, said]
    )


def _joined_negatives(fields: Sequence[Field], arguments: Sequence[str]) -> list[str]:
    """The arguments with numbers below zero joined to their option, --xyz -10mm,0mm,1mm to --xyz=-10mm,0mm,1mm: a word
    that begins with a dash would be taken for an option."""
    takes = {flag: f for f in fields for flag in (f.flag, f.option.short) if flag and f.inner is not bool}
    out: list[str] = []
    current = ""
    for word in arguments:
        if _NEGATIVE.match(word) and current and (out[-1] == current or takes[current].many):
            if out[-1] == current:
                out.pop()
            out.append(f"{current}={word}")
            continue
        if word.startswith("-"):
            current = word if word in takes else ""
        out.append(word)
    return out


def ended_names(fields: Sequence[Field], arguments: Sequence[str]) -> list[str]:
    """The arguments with words that can be no parameter's name taken out of --fix and put in front of all:
    `--fix k3 photos/*.jpg` names photos."""
    names = {flag for f in fields if f.option.names for flag in (f.flag, f.option.short) if flag}
    arguments = _joined_negatives(fields, arguments)
    front: list[str] = []
    rest: list[str] = []
    current, values = "", 0
    for argument in arguments:
        if argument.startswith("-"):
            current, values = argument, 0
        elif current in names and values and not argument.replace(",", "").isalnum():
            current = ""
            front.append(argument)
            continue
        elif current == "":
            front.append(argument)
            continue
        else:
            values += 1
        rest.append(argument)
    return [*front, *rest]


def _misuse(error: Exception, command: Command) -> str:
    """What is wrong with the arguments, in words."""
    from cyclopts import MissingArgumentError, UnknownOptionError, UnusedCliTokensError

    argument = getattr(error, "argument", None)
    if isinstance(error, UnknownOptionError):
        flag = error.token.keyword or error.token.value
        return f"No such option: {flag}{nearest(flag, command.flags)}"
    if isinstance(error, UnusedCliTokensError):
        return f"Unexpected argument: {' '.join(error.unused_tokens or ())}"
    if isinstance(error, MissingArgumentError) and argument is not None:
        given = error.keyword
        return f"{given} needs a value" if given else f"{argument.name} is missing"
    return " ".join(str(error).split()).rstrip(".")


def nearest(word: str, known: Iterable[str]) -> str:
    """Asks whether the one of the known words that is most like this one was meant; empty where none is like it."""
    from difflib import get_close_matches

    near = get_close_matches(word, sorted(known), n=1)
    return f" (did you mean {near[0]}?)" if near else ""


def values_of(command: Command, arguments: Sequence[str]) -> Mapping[str, Any]:
    """What the arguments say, by option."""
    return _app_of(command)(ended_names(command.fields, arguments), exit_on_error=False, print_error=False)
