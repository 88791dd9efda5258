"""Advice in the words of the door it is given at: `--setup` on a command line is the argument `setup` in Python.

Messages, checks and result files have one spelling, that of the command line, so that every door gives the same answer.
What Python shows (errors of the verbs, `print(result)`, `summary()`, a notebook) is told through `in_python`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

_OPTION = re.compile(r"(?P<command>\bcalibrant [a-z]+(?:-[a-z]+)*(?: [a-z-]+)? )?(?<![\w-])(?P<flag>--[a-z][a-z-]*)")


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
