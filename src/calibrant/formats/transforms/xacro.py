"""What stands in ${…} of a xacro file where it is arithmetic on numbers, pi and properties that the file gives.

Source: wiki.ros.org/xacro, "Math expressions", "Properties and Property Blocks", "Macros" (defaults as name:=value).
"""

from __future__ import annotations

import ast
import math
import operator
import re
import shlex
from collections.abc import Callable, Mapping
from contextlib import suppress
from xml.etree import ElementTree as ET

from calibrant.errors import InputError

NAMESPACE = "http://www.ros.org/wiki/xacro"
_EXPRESSION = re.compile(r"\$\{([^{}]{1,500})\}")
_DEEPEST = 10
"""Properties that are given by properties."""
_OPERATORS: dict[type[ast.AST], Callable[..., float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
_FUNCTIONS: dict[str, Callable[[float], float]] = {
    name: getattr(math, name) for name in ("radians", "degrees", "sin", "cos", "tan", "sqrt", "asin", "acos", "atan")
}


def is_part(element: ET.Element, name: str) -> bool:
    """Whether an element is xacro's own of that name."""
    return isinstance(element.tag, str) and element.tag.endswith(f"xacro}}{name}")


def within(element: ET.Element, names: Mapping[str, str]) -> Mapping[str, str]:
    """The names that hold inside an element: those from outside, its properties, the defaults of a macro."""
    found = {
        str(child.get("name")): str(child.get("value", child.get("default")))
        for child in element
        if is_part(child, "property")
    }
    if is_part(element, "macro"):
        with suppress(ValueError):
            for word in shlex.split(element.get("params", "")):
                name, equals, value = word.partition(":=")
                if equals:
                    found[name] = value.removeprefix("^|")
    return {**names, **found} if found else names


def evaluated(text: str, names: Mapping[str, str], where: str) -> str:
    """The text with every ${…} in it as what it is worth. Raises: InputError for what cannot be known from the file."""
    if "$(" in text:
        raise InputError(f"{where}: {text[:80]!r}: what stands in $(…) is known to xacro alone; give the URDF it makes")
    return _EXPRESSION.sub(lambda match: _value(match[1].strip(), names, where, 0), text)


def _value(expression: str, names: Mapping[str, str], where: str, depth: int) -> str:
    if expression in names:
        if depth > _DEEPEST:
            raise InputError(f"{where}: the property {expression!r} is given by itself")
        inner = names[expression]
        return _EXPRESSION.sub(lambda match: _value(match[1].strip(), names, where, depth + 1), inner)
    try:
        number = _number(ast.parse(expression, mode="eval").body, names, where, depth)
    except (SyntaxError, ValueError, TypeError, ArithmeticError, RecursionError, MemoryError):
        raise InputError(
            f"{where}: ${{{expression[:80]}}} cannot be worked out from this file; give the URDF that xacro makes of it"
        ) from None
    return repr(number)


def _number(node: ast.expr, names: Mapping[str, str], where: str, depth: int) -> float:
    """Raises: ValueError and its like for what is no arithmetic on known numbers."""
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return float(node.value)
    if isinstance(node, ast.Name):
        return (
            math.pi
            if node.id in ("pi", "M_PI") and node.id not in names
            else float(_known(node.id, names, where, depth))
        )
    if isinstance(node, ast.BinOp):
        left, right = (_number(side, names, where, depth) for side in (node.left, node.right))
        return _OPERATORS[type(node.op)](left, right) if type(node.op) in _OPERATORS else _refuse()
    if isinstance(node, ast.UnaryOp) and type(node.op) in _OPERATORS:
        return _OPERATORS[type(node.op)](_number(node.operand, names, where, depth))
    if isinstance(node, ast.Call) and len(node.args) == 1:
        name = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
        return _FUNCTIONS[name](_number(node.args[0], names, where, depth)) if name in _FUNCTIONS else _refuse()
    return _refuse()


def _known(name: str, names: Mapping[str, str], where: str, depth: int) -> str:
    return _value(name, names, where, depth + 1) if name in names else str(_refuse())


def _refuse() -> float:
    raise ValueError
