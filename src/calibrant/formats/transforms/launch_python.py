"""static_transform_publisher in launch files of Python, as MoveIt 2's hand-eye calibration saves them too.

    Node(package="tf2_ros", executable="static_transform_publisher", arguments=["--x", "0.1", …])

The file is not run: what it says is taken from its syntax, literals alone. Sources: docs.ros.org, "Using Python, XML
and YAML for ROS 2 launch files"; files that MoveIt 2's calibration has saved (personalrobotics/ada_ros2,
ada_moveit/calib/default/calib1/camera_calib_pose.launch.py).
"""

from __future__ import annotations

import ast
from collections.abc import Iterator

from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.formats.documents.document import Document
from calibrant.formats.documents.number_text import text_of
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, WriteOptions, answer
from calibrant.formats.transforms.command_lines import PUBLISHER_ASKS, ROTATIONS
from calibrant.formats.transforms.one import ASKS, Placed, as_result, placed
from calibrant.formats.transforms.publisher import PROGRAM, placed_of, ros2_words
from calibrant.reading.notes import note_unused

_LARGEST = 1_000_000
"""Characters: a launch file has some thousand."""
_SETUPS = {"eye-in-hand": "EYE-IN-HAND", "eye-on-base": "EYE-TO-HAND"}


def _matches(document: Document) -> bool:
    text = document.text or ""
    return PROGRAM in text and "LaunchDescription" in text and document.root is None


def _calls(tree: ast.AST) -> Iterator[ast.Call]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            values = {k.arg: k.value for k in node.keywords}
            program = values.get("executable") or values.get("node_executable")
            if isinstance(program, ast.Constant) and program.value == PROGRAM:
                yield node


def _words(call: ast.Call) -> list[str] | None:
    """The arguments, None where they are no literals."""
    found = next((k.value for k in call.keywords if k.arg == "arguments"), None)
    try:
        value = ast.literal_eval(found) if found is not None else None
    except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError):
        return None
    if isinstance(value, str):
        return value.split()
    if not isinstance(value, list | tuple) or not all(isinstance(v, str | int | float) for v in value):
        return None
    # One text may hold all arguments.
    return [word for v in value for word in (str(v).split() if len(value) == 1 else [str(v)])]


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    text, source = document.text or "", str(document.path)
    if len(text) > _LARGEST:
        raise InputError(f"{source} has {len(text):,} characters; a launch file of {_LARGEST:,} at most is read")
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise InputError(f"{source}: not Python ({type(error).__name__}: {str(error)[:80]})") from None
    found: list[Placed] = []
    open_lines: list[str] = []
    for call in _calls(tree):
        words = _words(call)
        if words is None:
            open_lines.append(f"line {call.lineno}")
        else:
            found.append(placed_of(words, f"{source}:{call.lineno}"))
    if not found:
        where = f"the arguments in {', '.join(open_lines)} are computed" if open_lines else "no node publishes one"
        raise InputError(f"{source}: no static transform in numbers: {where}; the file is read, not run")
    note_unused(source, (f"{line}: a static transform whose arguments are computed" for line in open_lines))
    return as_result(found, source)


def _nodes(result: CalibrationResult, options: WriteOptions) -> str:
    euler = answer(options.answers, "rotation", ROTATIONS) == "rpy"
    return "".join(_node(ros2_words(one, euler=euler)) for one in placed(result, options))


def _node(words: list[str], comment: str = "") -> str:
    pairs = "".join(f'                "{name}", {_quoted(value)},\n' for name, value in zip(words[::2], words[1::2]))
    return (
        "        Node(\n"
        '            package="tf2_ros",\n'
        f'            executable="{PROGRAM}",\n'
        '            output="log",\n'
        f"            arguments=[\n{pairs}{comment}            ],\n"
        "        ),\n"
    )


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _launch(heading: str, nodes: str) -> bytes:
    return (
        f"{heading}from launch import LaunchDescription\n"
        "from launch_ros.actions import Node\n\n\n"
        "def generate_launch_description():\n"
        f"    return LaunchDescription([\n{nodes}    ])\n"
    ).encode()


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    return _launch("", _nodes(result, options))


def _write_moveit(result: CalibrationResult, options: WriteOptions) -> bytes:
    setup = answer(options.answers, "setup", tuple(_SETUPS))
    nodes = ""
    ends = []
    for one in placed(result, options):
        rpy = "".join(
            f'                # "--{n}", "{v}",\n' for n, v in zip(("roll", "pitch", "yaw"), text_of(one.rpy))
        )
        nodes += _node(ros2_words(one), rpy)
        ends.append(f"{one.parent} -> {one.child}")
    said = f"{_SETUPS[setup]}: " if setup else ""
    heading = f'"""Static transform of a hand-eye calibration, {said}{", ".join(ends)}."""\n\n'
    return _launch(heading, nodes)


FORMAT = ExchangeFormat(
    name="ros2-launch",
    title="ROS 2 launch file (Python) with static_transform_publisher",
    suffix=".launch.py",
    matches=_matches,
    read=_read,
    write=_write,
    asks=PUBLISHER_ASKS,
)
MOVEIT_FORMAT = ExchangeFormat(
    name="moveit",
    title="launch file as MoveIt's hand-eye calibration saves it",
    suffix="camera_pose.launch.py",
    matches=lambda document: False,  # the first reads both
    write=_write_moveit,
    asks=ASKS | {"setup": f"what its heading says, {' or '.join(_SETUPS)}"},
)
