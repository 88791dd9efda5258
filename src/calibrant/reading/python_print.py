"""Numbers as Python prints them: lists, tuples and NumPy's arrays and scalars in each other, with or without a name.

    robot_poses = [[np.float64(0.74), 0.05], [0.53, 0.14]]      array([[1., 2.],
                                                                       [3., 4.]], dtype=float32)

Nothing is evaluated: brackets, numbers and the names of NumPy's types are all that is read, and a text that holds
anything else is none of these.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

from calibrant.reading.json_text import DEEPEST

_WRAPPER = (
    r"(?:(?:np|numpy|torch|jnp|cp)\s?\.\s?)?"
    r"(?:array|asarray|matrix|tensor|ndarray|float(?:16|32|64|128)?|u?int(?:8|16|32|64)?|double|longdouble)"
)
_TOKEN = re.compile(
    rf"[\s,;]*+(?:(?P<wrap>{_WRAPPER})\s*+\(|(?P<open>[\[(])|(?P<close>[\])])"
    r"|(?P<number>[-+]?(?:\d++\.?+\d*+|\.\d++)(?:[eE][-+]?\d++)?+(?![\w.]))"
    r"|(?P<said>(?:dtype|device|requires_grad|shape)\s*+=\s*+[\w.'\":<>]++)"
    r"|(?P<name>[A-Za-z_]\w{0,99}+)\s*+(?::\s*+[\w\[\], .]{0,60}+)?=(?!=)|(?P<end>\Z))"
)
_COMMENT = re.compile(r"(?m)#[^\n]*$|^\s*(?:import|from)\s[^\n]*$")


@dataclass
class _Open:
    """A bracket that is open. through: whether it is a call that stands for its first value."""

    through: bool
    values: list[Any] = field(default_factory=list)

    @property
    def value(self) -> Any:
        return self.values[0] if self.through and self.values else self.values


def read_python(text: str) -> Any:
    """The value printed in a text, or the values by their names; None for any other text."""
    if "[" not in text and "(" not in text:
        return None
    body = _COMMENT.sub("", text)
    named: dict[str, Any] = {}
    name: str | None = None
    stack = [_Open(False)]
    at = 0
    while True:
        token = _TOKEN.match(body, at)
        if token is None:
            return None
        at = token.end()
        kind = token.lastgroup
        if kind in ("wrap", "open"):
            stack.append(_Open(kind == "wrap"))
            if len(stack) > DEEPEST:
                return None
        elif kind == "close":
            if len(stack) == 1:
                return None
            done = stack.pop()
            stack[-1].values.append(done.value)
        elif kind == "number":
            stack[-1].values.append(float(token["number"]))
        elif kind in ("name", "end"):
            if len(stack) > 1:
                return None
            found = stack[0].values
            if len(found) > 1 or (name is not None and not found):
                # Arrays printed one after the other: as many poses.
                if name is not None or any(not isinstance(value, list) for value in found):
                    return None
                found = [found]
            if found:
                if name in named or (name is None and named):
                    return None
                named[name or ""] = found[0]
            stack = [_Open(False)]
            if kind == "end":
                break
            name = token["name"]
    if not named:
        return None
    return named[""] if list(named) == [""] else named
