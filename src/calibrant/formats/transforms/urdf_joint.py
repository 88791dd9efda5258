"""Fixed joints of a URDF, and of a xacro file: read, and one written with its links, to paste or to include.

    <joint name="…" type="fixed"><parent link="…"/><child link="…"/><origin xyz="…" rpy="…"/></joint>

The origin is T_parent_child: metres, radians, R = Rz(yaw) Ry(pitch) Rx(roll) (http://wiki.ros.org/urdf/XML/joint).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from xml.etree import ElementTree as ET

from calibrant.arrays import Array
from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.formats.documents.document import Document
from calibrant.formats.documents.number_text import text_of
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, WriteOptions
from calibrant.formats.exchange.rotation_numbers import finite
from calibrant.formats.transforms.one import ASKS, Placed, as_result, placed
from calibrant.formats.transforms.xacro import NAMESPACE, evaluated, within
from calibrant.geometry import rotations, se3
from calibrant.reading.notes import note_unused

_NAME = "calibrated"


def _matches(document: Document) -> bool:
    root = document.root
    if root is None or root.tag not in ("robot", "joint"):
        return False
    return root.find("parent") is not None if root.tag == "joint" else any(True for _ in root.iter("joint"))


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    if document.root is None:
        raise InputError(document.trouble or f"{document.path} is not XML")
    source = str(document.path)
    found: list[Placed] = []
    moving: list[str] = []
    for joint, names in _joints(document.root, {}):
        name = joint.get("name", "joint")
        if joint.get("type", "fixed") != "fixed":
            moving.append(f"{joint.get('type')} joint {name}")
        elif joint.find("parent") is not None:
            found.append(_fixed(joint, names, f"{source}: joint {name!r}"))
    if not found and moving:
        raise InputError(f"{source}: no fixed joint in it; {len(moving)} that move have no one transform")
    note_unused(source, moving)
    return as_result(found, source)


def _joints(element: ET.Element, names: Mapping[str, str]) -> Iterator[tuple[ET.Element, Mapping[str, str]]]:
    """Joints at any depth of a xacro file, each with the properties that hold there."""
    inside = within(element, names)
    if element.tag == "joint":
        yield element, inside
        return
    if element.tag in ("transmission", "gazebo", "ros2_control"):  # their joints are names of others
        return
    for child in element:
        yield from _joints(child, inside)


def _fixed(joint: ET.Element, names: Mapping[str, str], where: str) -> Placed:
    ends = {}
    for role in ("parent", "child"):
        end = joint.find(role)
        link = None if end is None else end.get("link")
        if not link:
            raise InputError(f"{where} has no <{role} link=…>")
        ends[role] = evaluated(link, names, where)
    return Placed(ends["parent"], ends["child"], _origin(joint, names, where))


def _origin(joint: ET.Element, names: Mapping[str, str], where: str) -> Array:
    origin = joint.find("origin")
    xyz, rpy = (
        finite(
            evaluated("0 0 0" if origin is None else origin.get(key, "0 0 0"), names, where).split(),
            3,
            f"{where}: {key}",
        )
        for key in ("xyz", "rpy")
    )
    return se3.make(rotations.matrix_from_euler(rpy, order="xyz", unit="rad"), xyz)


def _joint(one: Placed, *, parent: str | None = None, child: str | None = None) -> ET.Element:
    joint = ET.Element("joint", name=f"{one.parent}_to_{one.child}", type="fixed")
    ET.SubElement(joint, "parent", link=parent or one.parent)
    ET.SubElement(joint, "child", link=child or one.child)
    ET.SubElement(joint, "origin", xyz=" ".join(text_of(one.xyz)), rpy=" ".join(text_of(one.rpy)))
    return joint


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    root = ET.Element("robot", name=_NAME)
    parts = placed(result, options)
    for link in (parts[0].parent, *(one.child for one in parts)):
        ET.SubElement(root, "link", name=link)
    root.extend(_joint(one) for one in parts)
    return _text(root)


def _write_xacro(result: CalibrationResult, options: WriteOptions) -> bytes:
    """A macro that hangs the camera on a link that exists already; the file calls it by itself for none."""
    ET.register_namespace("xacro", NAMESPACE)
    root = ET.Element("robot")
    parts = placed(result, options)
    macro = ET.SubElement(
        root, f"{{{NAMESPACE}}}macro", name=f"calibrated_{parts[-1].child}", params=f"parent:={parts[0].parent}"
    )
    for k, one in enumerate(parts):
        ET.SubElement(macro, "link", name=one.child)
        macro.append(_joint(one, parent=None if k else "${parent}"))
    return _text(root)


def _text(root: ET.Element) -> bytes:
    ET.indent(root)
    return ('<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n").encode()


FORMAT = ExchangeFormat(
    name="urdf-joint",
    title="fixed joint of a URDF",
    suffix=".urdf",
    matches=_matches,
    read=_read,
    write=_write,
    asks=ASKS,
)
XACRO_FORMAT = ExchangeFormat(
    name="xacro",
    title="xacro macro with a fixed joint",
    suffix=".xacro",
    matches=lambda document: False,  # the first reads both
    write=_write_xacro,
    asks=ASKS,
)
