"""Command lines of static_transform_publisher, for ROS 1 and ROS 2; read from any text that has them.

rosrun tf static_transform_publisher 0.1 0 0.2 0 0 0 1 tool0 camera 100
ros2 run tf2_ros static_transform_publisher --x 0.1 --z 0.2 --qw 1 --frame-id tool0 --child-frame-id camera
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator

from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import (
    ExchangeFormat,
    ReadOptions,
    WriteOptions,
    answer,
)
from calibrant.formats.transforms.one import ASKS, Placed, as_result, placed
from calibrant.formats.transforms.publisher import PERIOD_MS, PROGRAM, placed_of, ros1_words, ros2_words

ROTATIONS = ("quaternion", "rpy")
PUBLISHER_ASKS = ASKS | {"rotation": f"how the rotation is written, {' or '.join(ROTATIONS)}"}
_ENDS = (";", "&", "&&", "|", "||", ">")


def _matches(document: Document) -> bool:
    text = document.text or ""
    return PROGRAM in text and document.root is None and any(True for _ in _calls(text))


def _calls(text: str) -> Iterator[tuple[int, str]]:
    """Number and text of each line that runs the publisher: what a backslash ends goes on, comments do not count."""
    number, open_line = 0, ""
    for i, line in enumerate(text.splitlines(), start=1):
        number = number if open_line else i
        open_line += line.rstrip()
        if open_line.endswith("\\"):
            open_line = open_line[:-1] + " "
            continue
        before, found, after = open_line.partition(PROGRAM)
        if found and _runs(before):
            yield number, after
        open_line = ""


def _runs(before: str) -> bool:
    """Whether what stands before the program's name leads to it: rosrun tf, ros2 run tf2_ros, a path, nothing."""
    words = before.split()
    return not before.lstrip().startswith("#") and (
        not words or words[-1] in ("tf", "tf2_ros") or words[-1].endswith("/")
    )


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    found: list[Placed] = []
    for number, rest in _calls(document.text or ""):
        where = f"{document.path}:{number}"
        try:
            words = shlex.split(rest, comments=True)
        except ValueError as error:
            raise InputError(f"{where}: {error}") from None
        end = next((i for i, word in enumerate(words) if word in _ENDS), len(words))
        found.append(placed_of(words[:end], where))
    return as_result(found, str(document.path))


def _euler(options: WriteOptions) -> bool:
    return answer(options.answers, "rotation", ROTATIONS) == "rpy"


def _write_ros1(result: CalibrationResult, options: WriteOptions) -> bytes:
    period = options.answers.get("period", PERIOD_MS)
    lines = [
        shlex.join(["rosrun", "tf", PROGRAM, *ros1_words(one, euler=_euler(options), period=period)])
        for one in placed(result, options)
    ]
    return ("".join(f"{line} &\n" for line in lines[:-1]) + lines[-1] + "\n").encode()


def _write_ros2(result: CalibrationResult, options: WriteOptions) -> bytes:
    lines = [
        shlex.join(["ros2", "run", "tf2_ros", PROGRAM, *ros2_words(one, euler=_euler(options))])
        for one in placed(result, options)
    ]
    return ("".join(f"{line} &\n" for line in lines[:-1]) + lines[-1] + "\n").encode()


ROS1_FORMAT = ExchangeFormat(
    name="ros1-static-transform",
    title="command line of ROS 1's static_transform_publisher",
    suffix=".sh",
    matches=_matches,
    read=_read,
    write=_write_ros1,
    asks=PUBLISHER_ASKS | {"period": "ms between two messages"},
)
ROS2_FORMAT = ExchangeFormat(
    name="ros2-static-transform",
    title="command line of ROS 2's static_transform_publisher",
    suffix=".sh",
    matches=lambda document: False,  # the first reads both
    write=_write_ros2,
    asks=PUBLISHER_ASKS,
)
