"""Advice in the words of the door it is given at: `--setup` on a command line is the argument `setup` in Python.

Messages, checks and result files have one spelling, that of the command line, so that every door gives the same answer.
What Python shows is told through this file: errors of the verbs, `print(result)`, `summary()`, a notebook
(`in_python`), and errors of the other public functions (`python_door`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from typing import Any

from calibrant.errors import CalibrantError

_OPTION = re.compile(r"(?P<command>\bcalibrant [a-z]+(?:-[a-z]+)*(?: [a-z-]+)? )?(?<![\w-])(?P<flag>--[a-z][a-z-]*)")
FORCE = "force=True"
"""What `--force` is in Python: advice to give it says the value."""


def in_python(message: str, names: Mapping[str, str] | None = None) -> str:
    """The message with arguments in the place of options; a command line in it stays one.

    Args: names: the argument of each option that the function has, others stay; by default every option is one.
    """

    def named(found: re.Match[str]) -> str:
        flag = found["flag"]
        if found["command"]:
            return found[0]
        return flag[2:].replace("-", "_") if names is None else names.get(flag, flag)

    return _OPTION.sub(named, message)


def python_door(function: Callable[..., Any], name: str) -> Callable[..., Any]:
    """The function as `calibrant.name`: its errors name its arguments, not the options of the command beside it.

    The function itself stays as it is, for commands that call it speak of options.
    """

    @wraps(function)
    def door(*args: Any, **kwargs: Any) -> Any:
        try:
            return function(*args, **kwargs)
        except CalibrantError as error:
            error.args = (in_python(in_python(str(error), _own_names(str(error), function))),)
            raise

    # A process pool finds a function by its name: at this one it finds the door.
    door.__module__, door.__qualname__ = "calibrant", name
    return door


def _own_names(message: str, function: Callable[..., Any]) -> dict[str, str]:
    """Options in the message that are arguments of the function, if with a unit (`--max-error`: max_error_px)."""
    from inspect import signature

    return dict(_arguments({found["flag"] for found in _OPTION.finditer(message)}, signature(function).parameters))


def _arguments(flags: Iterable[str], parameters: Iterable[str]) -> Iterable[tuple[str, str]]:
    parameters = tuple(parameters)
    for flag in flags:
        word = flag[2:].replace("-", "_")
        with_unit = [name for name in parameters if re.fullmatch(rf"{word}_(px|m|mm|s|deg|rad)", name)]
        if flag == "--force":
            yield flag, FORCE
        elif word in parameters or with_unit:
            yield flag, word if word in parameters else with_unit[0]
