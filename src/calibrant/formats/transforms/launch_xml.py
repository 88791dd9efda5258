"""static_transform_publisher in launch files of XML: ROS 1 (roslaunch) and ROS 2 (launch_xml).

    <node pkg="tf2_ros" type="static_transform_publisher" name="…" args="x y z qx qy qz qw frame child"/>
    <node pkg="tf2_ros" exec="static_transform_publisher" name="…" args="--x … --frame-id … --child-frame-id …"/>

Sources: wiki.ros.org/roslaunch/XML/node; docs.ros.org, "Migrating launch files from ROS 1 to ROS 2".
"""

from __future__ import annotations

import re
import shlex
from xml.etree import ElementTree as ET

from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, WriteOptions, answer
from calibrant.formats.transforms.command_lines import PUBLISHER_ASKS, ROTATIONS
from calibrant.formats.transforms.one import Placed, as_result, placed
from calibrant.formats.transforms.publisher import PROGRAM, placed_of, ros1_words, ros2_words
from calibrant.reading.notes import note, note_unused

_SUBSTITUTED = ("$(", "${")
_ARGUMENT = re.compile(r"\$\((?:arg|var) ([^()\s]+)\)")


def _publishers(root: ET.Element) -> list[ET.Element]:
    return [e for e in root.iter("node") if PROGRAM in (e.get("type"), e.get("exec"))]


def _matches(document: Document) -> bool:
    return document.root is not None and document.root.tag == "launch" and bool(_publishers(document.root))


def _arguments(root: ET.Element) -> dict[str, str]:
    """What the file's own <arg> elements say in words, by name; none that says two things."""
    said: dict[str, set[str]] = {}
    for element in root.iter("arg"):
        value = element.get("value", element.get("default"))
        if element.get("name") and value is not None:
            said.setdefault(element.get("name", ""), set()).add(value)
    once = {name: next(iter(values)) for name, values in said.items() if len(values) == 1}
    return {name: value for name, value in once.items() if not any(mark in value for mark in _SUBSTITUTED)}


def _filled(args: str, arguments: dict[str, str], where: str) -> str:
    """The words with each $(arg NAME) that the file itself gives a value, which is said."""
    known = [name for name in dict.fromkeys(_ARGUMENT.findall(args)) if name in arguments]
    if known:
        listed = ", ".join(f"{name} = {arguments[name]}" for name in known)
        note(f"{where}: with the file's own arguments: {listed}")
    return _ARGUMENT.sub(lambda match: arguments.get(match[1], match[0]), args)


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    if document.root is None:
        raise InputError(document.trouble or f"{document.path} is not XML")
    found: list[Placed] = []
    open_ones: list[str] = []
    arguments = _arguments(document.root)
    for element in _publishers(document.root):
        name = element.get("name", PROGRAM)
        args = _filled(element.get("args", ""), arguments, f"{document.path}: node {name!r}")
        if any(mark in args for mark in _SUBSTITUTED):
            open_ones.append(f"{name} (args={args[:60]!r}: what stands in $(…) is known to roslaunch alone)")
            continue
        where = f"{document.path}: node {name!r}"
        try:
            words = shlex.split(args)
        except ValueError as error:
            raise InputError(f"{where}: args: {error}") from None
        found.append(placed_of(words, where))
    if not found:
        raise InputError(f"{document.path}: no static transform in numbers: {'; '.join(open_ones)}")
    others = [f"node {e.get('name', '')}" for e in document.root.iter("node") if e not in _publishers(document.root)]
    note_unused(str(document.path), [*open_ones, *others, *(e.tag for e in document.root if e.tag == "include")])
    return as_result(found, str(document.path))


def _launch(result: CalibrationResult, options: WriteOptions, key: str) -> bytes:
    euler = answer(options.answers, "rotation", ROTATIONS) == "rpy"
    root = ET.Element("launch")
    for one in placed(result, options):
        words = ros1_words(one, euler=euler, period=None) if key == "type" else ros2_words(one, euler=euler)
        name = "".join(c if c.isalnum() else "_" for c in f"{one.parent}_to_{one.child}".lstrip("/"))
        ET.SubElement(root, "node", {"pkg": "tf2_ros", key: PROGRAM, "name": name, "args": shlex.join(words)})
    ET.indent(root)
    return (ET.tostring(root, encoding="unicode") + "\n").encode()


def _write_ros1(result: CalibrationResult, options: WriteOptions) -> bytes:
    return _launch(result, options, "type")


def _write_ros2(result: CalibrationResult, options: WriteOptions) -> bytes:
    return _launch(result, options, "exec")


ROS1_FORMAT = ExchangeFormat(
    name="ros1-launch",
    title="ROS 1 launch file with static_transform_publisher",
    suffix=".launch",
    matches=_matches,
    read=_read,
    write=_write_ros1,
    asks=PUBLISHER_ASKS,
)
ROS2_FORMAT = ExchangeFormat(
    name="ros2-launch-xml",
    title="ROS 2 launch file (XML) with static_transform_publisher",
    suffix=".launch.xml",
    matches=lambda document: False,  # the first reads both
    write=_write_ros2,
    asks=PUBLISHER_ASKS,
)
