"""The tree of a URDF: its joints' ends, checked before a chain is read from them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from calibrant.arrays import Array
from calibrant.errors import InputError

_USED_OF = {"link": ("inertial",), "joint": ("origin", "parent", "child", "axis", "limit", "mimic")}
"""What is read of a robot's elements. Comments in them have no name."""
_LISTED = 12
"""Names in a message: more scroll away."""


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """A joint between two links, by name; origin (4, 4), metres, in the parent."""

    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    element: ET.Element


def check_tree(links: Sequence[str], joints: Sequence[UrdfJoint], source: str) -> None:
    """Raises: InputError for names given twice, links that are not there, two parents, links in a circle."""
    for what, names in (("link", links), ("joint", [j.name for j in joints])):
        twice = next((name for name, times in Counter(names).items() if times > 1), None)
        if twice is not None:
            raise InputError(f"{source}: two {what}s are called {twice!r}; give each a name of its own")
    by_child: dict[str, UrdfJoint] = {}
    for joint in joints:
        for role, end in (("parent", joint.parent), ("child", joint.child)):
            if end not in links:
                raise InputError(
                    f"{source}: joint {joint.name!r} has the {role} {end!r}, and there is no such link; the links are "
                    f"{listed(links)}"
                )
        first = by_child.setdefault(joint.child, joint)
        if first is not joint:
            raise InputError(
                f"{source}: link {joint.child!r} hangs on two joints, {first.name!r} and {joint.name!r}; a URDF is a "
                "tree: of a closed mechanism keep the joints of one branch, the others follow it (<mimic>)"
            )
    circle = _circle(links, by_child)
    if circle:
        around = " -> ".join((*circle, circle[0]))
        names = ", ".join(repr(by_child[name].name) for name in circle)
        raise InputError(
            f"{source}: the links hang on each other in a circle, {around} (joints {names}); a robot begins at a base: "
            "correct the parent of one of these joints"
        )


def _circle(links: Sequence[str], by_child: Mapping[str, UrdfJoint]) -> list[str]:
    """Links that hang on each other, each after the one it hangs on; empty where every link leads to a root."""
    for start in links:
        above = [start]
        while above[-1] in by_child:
            parent = by_child[above[-1]].parent
            if parent in above:
                return above[above.index(parent) :][::-1]
            above.append(parent)
    return []


def only_root(links: Sequence[str], by_child: Mapping[str, UrdfJoint], source: str) -> str:
    """The base of the robot. Raises: InputError unless one link, and one only, hangs on no other."""
    roots = [name for name in links if name not in by_child]
    if len(roots) != 1:
        raise InputError(f"{source}: {len(roots)} links without a parent ({listed(roots)}); a robot has one base")
    return roots[0]


def only_leaf(base: str, joints: Sequence[UrdfJoint], source: str) -> str:
    """The link at the end of the only moving chain: the last one that does not branch into two moving joints."""
    children: dict[str, list[UrdfJoint]] = {}
    for joint in joints:
        children.setdefault(joint.parent, []).append(joint)
    leaves: list[str] = []
    open_links = [base]
    while open_links:
        at = open_links.pop(0)
        below = children.get(at, [])
        open_links += [j.child for j in below]
        if not below:
            leaves.append(at)
    if len(leaves) != 1:
        raise InputError(f"{source}: the robot ends in several links ({listed(leaves)}); choose one with --robot-link")
    return leaves[0]


def unused(root: ET.Element, path: Sequence[str], joints: Sequence[UrdfJoint]) -> list[str]:
    """What a chain through the joints `path` takes nothing from: other moving joints by name, the rest by its tags.

    Of a link the mass and its place are used, of a joint of the chain what moves it and its limits.
    """
    out = [f"joint {j.name}" for j in joints if j.kind != "fixed" and j.name not in path]
    tags: Counter[str] = Counter()
    for element in root:
        if not isinstance(element.tag, str):  # a comment
            continue
        if element.tag not in _USED_OF:
            tags[element.tag] += 1
        elif element.tag == "link" or element.get("name") in path:
            tags.update(e.tag for e in element if isinstance(e.tag, str) and e.tag not in _USED_OF[element.tag])
    return [*out, *(f"{tag} ({times})" if times > 1 else tag for tag, times in tags.items())]


def listed(names: Sequence[str]) -> str:
    """Names for a message."""
    return ", ".join(names[:_LISTED]) + (" …" if len(names) > _LISTED else "") if names else "none"
