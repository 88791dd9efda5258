"""URDF: reading the chain to a link as joints and links, and writing a corrected chain back into the file.

Origins are xyz in metres and rpy in radians, R = Rz(yaw) Ry(pitch) Rx(roll); a joint's axis is in its own frame
(http://wiki.ros.org/urdf/XML/joint). Fixed joints become part of the links; a joint that mimics another follows it with
its multiplier and offset. Writing changes the origins of the chain's joints and nothing else.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.formats.documents.number_text import row_of
from calibrant.formats.robots.urdf_tree import UrdfJoint, check_tree, listed, only_leaf, only_root, unused
from calibrant.geometry import rotations, se3
from calibrant.robots.chain import Joint, KinematicChain
from calibrant.robots.links import LinkChain, Load, Mover, as_links

_MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True, eq=False)
class UrdfChain:
    """A chain read from URDF text: from link `base` to link `tip` through the joints `path`, fixed ones too.

    unused: what the file has beside it, in words.
    """

    chain: LinkChain
    base: str
    tip: str
    path: tuple[str, ...]
    text: str
    source: str
    unused: tuple[str, ...] = ()


def parse_urdf(text: str, source: str, *, link: str | None = None, base: str | None = None) -> UrdfChain:
    """The chain from link `base` (the root by default) to `link` (the only leaf below it by default).

    Args: text of a URDF; source names it in messages. Raises: InputError naming what is wrong: no XML, no such link
    (with those there are), several leaves, joints of other kinds in the chain, limits that are missing or reversed,
    links that are no tree.
    """
    root = _urdf_root(text, source)
    joints = [_joint(element, source) for element in root.findall("joint")]
    by_child = {j.child: j for j in joints}
    links = [str(e.get("name")) for e in root.findall("link")]
    check_tree(links, joints, source)
    start = base if base is not None else only_root(links, by_child, source)
    for name in (start, *([link] if link else [])):
        if name not in links:
            raise InputError(f"{source}: no link {name!r}; the links are {listed(links)}")
    tip = link if link is not None else only_leaf(start, joints, source)
    path: list[UrdfJoint] = []
    at = tip
    while at != start:
        if at not in by_child:
            raise InputError(f"{source}: link {tip!r} does not hang on link {start!r}; its chain begins at {at!r}")
        path.insert(0, by_child[at])
        at = by_child[at].parent
    chain = _chain(path, joints, root, source)
    names = tuple(j.name for j in path)
    driven = (*names, *(j.name for j in chain.joints))
    return UrdfChain(chain, start, tip, names, text, source, tuple(unused(root, driven, joints)))


def corrected_urdf(original: UrdfChain, chain: LinkChain) -> str:
    """The URDF text with the origins of the chain's joints replaced by those of `chain`.

    A change behind the last joint (F_end) goes into the fixed joint that follows it. Raises: InputError when there is
    none and F_end has changed, or the chain is another one.
    """
    if [m.name for m in chain.movers] != [m.name for m in original.chain.movers]:
        raise InputError(f"{original.source}: the corrected chain has other joints than the file's chain")
    root = _urdf_root(original.text, original.source)
    elements = {str(e.get("name")): e for e in root.findall("joint")}
    movers = [m.name for m in chain.movers]
    before = np.eye(4)
    last_fixed: str | None = None
    after_last: Array = np.eye(4)
    for name in original.path:
        if name in movers:
            k = movers.index(name)
            _set_origin(elements[name], se3.inverse(before) @ chain.links[k])
            before, after_last, last_fixed = np.eye(4), np.eye(4), None
        else:
            origin = _origin(elements[name], original.source)
            before = before @ origin
            if last_fixed is None:
                last_fixed = name
            else:
                after_last = after_last @ origin
    if np.abs(chain.links[-1] - original.chain.links[-1]).max() > 1e-12:
        if last_fixed is None:
            raise InputError(
                f"{original.source}: the transform behind joint {movers[-1]!r} has changed, but link {original.tip!r} "
                "hangs on it directly; add a fixed joint for the flange, or free the tool instead"
            )
        _set_origin(elements[last_fixed], chain.links[-1] @ se3.inverse(after_last))
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def new_urdf(chain: KinematicChain, *, name: str = "robot") -> str:
    """URDF text of any chain: links base_link, link_1 ... flange, and its limits; no shapes, no masses.

    Raises: InputError for a chain in which joints mimic others.
    """
    links = as_links(chain)
    if len(links.movers) != len(links.joints):
        raise InputError("a chain with joints that mimic others is written into its own URDF only")
    root = ET.Element("robot", name=name)
    names = ["base_link", *(f"link_{k}" for k in range(1, len(links.movers) + 1)), "flange"]
    for link in names:
        ET.SubElement(root, "link", name=link)
    for k, (joint, mover) in enumerate(zip(links.joints, links.movers)):
        endless = not (np.isfinite(joint.lower) and np.isfinite(joint.upper))
        kind = "continuous" if endless and mover.kind == "revolute" else mover.kind
        element = _add_joint(root, joint.name, kind, names[k], names[k + 1], links.links[k])
        ET.SubElement(element, "axis", xyz=row_of(np.asarray(mover.axis)))
        if not endless:
            limits = {"lower": repr(joint.lower), "upper": repr(joint.upper), "effort": "0", "velocity": "0"}
            ET.SubElement(element, "limit", limits)
    _add_joint(root, "flange_joint", "fixed", names[-2], names[-1], links.links[-1])
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _add_joint(root: ET.Element, name: str, kind: str, parent: str, child: str, T: Array) -> ET.Element:
    element = ET.SubElement(root, "joint", name=name, type=kind)
    ET.SubElement(element, "parent", link=parent)
    ET.SubElement(element, "child", link=child)
    _set_origin(element, T)
    return element


def _urdf_root(text: str, source: str) -> ET.Element:
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(f"{source}: document types and entities are not part of URDF; remove them")
    parser = ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))
    try:
        root = ET.fromstring(text, parser=parser)
    except ET.ParseError as error:
        raise InputError(f"{source}: not XML ({error}); expected a URDF robot") from error
    if "xacro" in text and any("xacro" in str(e.tag) or "${" in str(e.attrib) for e in root.iter()):
        raise InputError(f"{source}: holds xacro macros; expand them first: xacro {source} > robot.urdf")
    if root.tag != "robot":
        raise InputError(f"{source}: the root element is <{root.tag}>, expected <robot>")
    return root


def _joint(element: ET.Element, source: str) -> UrdfJoint:
    name = element.get("name")
    if not name:
        raise InputError(f"{source}: a joint without a name")
    ends: list[str] = []
    for role in ("parent", "child"):
        end = element.find(role)
        if end is None or not end.get("link"):
            raise InputError(f"{source}: joint {name!r} has no {role} link")
        ends.append(str(end.get("link")))
    return UrdfJoint(name, element.get("type", ""), ends[0], ends[1], _origin(element, source), element)


def _origin(element: ET.Element, source: str) -> Array:
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    where = f"{source}: the origin of {element.get('name', element.tag)!r}"
    xyz, rpy = (_triple(origin.get(key, "0 0 0"), f"{where}, {key}") for key in ("xyz", "rpy"))
    return se3.make(rotations.matrix_from_euler(rpy, order="xyz", unit="rad"), xyz)


def _triple(text: str, where: str) -> Array:
    try:
        values = np.array([float(v) for v in text.split()])
    except ValueError as error:
        raise InputError(f"{where}: {text!r}, expected three numbers") from error
    if values.shape != (3,) or not np.all(np.isfinite(values)):
        raise InputError(f"{where}: {text!r}, expected three finite numbers")
    return values


def _set_origin(element: ET.Element, T: Array) -> None:
    origin = element.find("origin")
    if origin is None:
        origin = ET.Element("origin")
        element.insert(0, origin)
    origin.attrib.clear()
    rpy = rotations.euler_from_matrix(T[:3, :3], order="xyz", unit="rad")
    origin.set("xyz", row_of(T[:3, 3]))
    origin.set("rpy", row_of(rpy))


def _chain(path: Sequence[UrdfJoint], joints: Sequence[UrdfJoint], root: ET.Element, source: str) -> LinkChain:
    by_name = {j.name: j for j in joints}
    moving = [j for j in path if j.kind != "fixed"]
    for joint in moving:
        if joint.kind not in _MOVING:
            known = ", ".join(("fixed", *_MOVING))
            raise InputError(f"{source}: joint {joint.name!r} is of type {joint.kind!r}; in a chain: {known}")
    if not moving:
        raise InputError(f"{source}: no joint moves between these links; choose another link: --robot-link NAME")
    rules = [_rule(j, by_name, source) for j in moving]
    driven = list(dict.fromkeys(driver for driver, _, _ in rules))
    mixing, offset = np.zeros((len(moving), len(driven))), np.zeros(len(moving))
    for k, (driver, multiplier, shift) in enumerate(rules):
        mixing[k, driven.index(driver)] = multiplier
        offset[k] = shift
    links, carried = _links(path)
    kinds = ["prismatic" if j.kind == "prismatic" else "revolute" for j in moving]
    movers = tuple(Mover(j.name, _joint_axis(j, source), kind) for j, kind in zip(moving, kinds))  # type: ignore[arg-type]
    loads = _loads(root, joints, carried, source)
    return LinkChain(tuple(_limits(by_name[d], source) for d in driven), movers, links, mixing, offset, loads)


def _links(path: Sequence[UrdfJoint]) -> tuple[Array, list[tuple[str, int, Array]]]:
    """F_1 ... F_end, and each link of the chain with the mover that carries it and its pose in that mover's frame."""
    links: list[Array] = []
    carried: list[tuple[str, int, Array]] = []
    T = np.eye(4)
    for joint in path:
        T = T @ joint.origin
        if joint.kind != "fixed":
            links.append(T)
            T = np.eye(4)
        if links:
            carried.append((joint.child, len(links) - 1, T))
    return np.array([*links, T]), carried


def _rule(joint: UrdfJoint, by_name: Mapping[str, UrdfJoint], source: str) -> tuple[str, float, float]:
    """The joint that drives this one, with multiplier and offset: x = multiplier * q + offset."""
    multiplier, offset, at = 1.0, 0.0, joint
    for _ in range(len(by_name)):
        mimic = at.element.find("mimic")
        if mimic is None:
            return at.name, multiplier, offset
        driver = mimic.get("joint", "")
        if driver not in by_name:
            raise InputError(f"{source}: joint {at.name!r} mimics {driver!r}, which is no joint of the robot")
        factor, shift = (
            _urdf_number(mimic, key, default, at, source) for key, default in (("multiplier", 1), ("offset", 0))
        )
        multiplier, offset = multiplier * factor, offset + multiplier * shift
        at = by_name[driver]
    raise InputError(f"{source}: joint {joint.name!r} mimics itself in a circle")


def _urdf_number(element: ET.Element, key: str, default: float | None, joint: UrdfJoint, source: str) -> float:
    text = element.get(key)
    if text is None and default is not None:
        return float(default)
    try:
        value = float(str(text))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{source}: joint {joint.name!r}: {key} is {text!r}, expected a number")
    return value


def _limits(joint: UrdfJoint, source: str) -> Joint:
    kind = "prismatic" if joint.kind == "prismatic" else "revolute"
    if joint.kind == "continuous":
        return Joint(joint.name, -math.inf, math.inf)
    limit = joint.element.find("limit")
    if limit is None:
        raise InputError(f"{source}: joint {joint.name!r} is {joint.kind} and has no <limit lower upper>; add it")
    lower, upper = (_urdf_number(limit, key, 0.0, joint, source) for key in ("lower", "upper"))
    if not lower < upper:
        raise InputError(f"{source}: joint {joint.name!r}: limits {lower:g} to {upper:g}; the lower comes first")
    return Joint(joint.name, lower, upper, kind)  # type: ignore[arg-type]


def _joint_axis(joint: UrdfJoint, source: str) -> tuple[float, float, float]:
    element = joint.element.find("axis")
    where = f"{source}: the axis of joint {joint.name!r}"
    values = _triple("1 0 0" if element is None else element.get("xyz", "1 0 0"), where)
    if np.linalg.norm(values) < 1e-9:
        raise InputError(f"{where} is 0 0 0; expected a direction")
    x, y, z = values.tolist()
    return x, y, z


def _loads(
    root: ET.Element, joints: Sequence[UrdfJoint], carried: list[tuple[str, int, Array]], source: str
) -> tuple[Load, ...]:
    """Masses of the chain's links and of what is fixed to them."""
    known = {name for name, _, _ in carried}
    open_links = list(carried)
    inertials = {str(e.get("name")): e.find("inertial") for e in root.findall("link")}
    loads: list[Load] = []
    while open_links:
        name, mover, T = open_links.pop(0)
        for joint in joints:
            if joint.parent == name and joint.kind == "fixed" and joint.child not in known:
                known.add(joint.child)
                open_links.append((joint.child, mover, T @ joint.origin))
        inertial = inertials.get(name)
        mass = None if inertial is None else inertial.find("mass")
        if inertial is None or mass is None:
            continue
        try:
            kilograms = float(mass.get("value", "0"))
        except ValueError as error:
            raise InputError(f"{source}: the mass of link {name!r} is {mass.get('value')!r}, expected kg") from error
        if kilograms > 0:
            x, y, z = (T @ _origin(inertial, source))[:3, 3].tolist()
            loads.append(Load(mover, kilograms, (x, y, z)))
    return tuple(loads)
