"""Denavit-Hartenberg tables as YAML.

    convention: standard            # or modified
    units: {length: mm, angle: deg}
    joints:
      - {name: joint_1, a: 0, alpha: 90, d: 162.5, theta: 0, lower: -360, upper: 360}
      - {name: rail, kind: prismatic, a: 0, alpha: 0, d: 0, lower: 0, upper: 1000}

beta (Hayati's turn about y) may stand beside them; theta, beta, kind may be left out. Limits are in the joint's unit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import yaml

from calibrant.errors import InputError
from calibrant.reading.notes import note_unused
from calibrant.robots.chain import Joint
from calibrant.robots.dh import DHChain, DHRow, ModifiedDH, StandardDH
from calibrant.targets.yaml_file import parse_yaml

CONVENTIONS: dict[str, type[StandardDH] | type[ModifiedDH]] = {"standard": StandardDH, "modified": ModifiedDH}
_LENGTHS = {"m": 1.0, "mm": 1e-3}
_ANGLES = {"rad": 1.0, "deg": math.pi / 180}
_LARGEST = 1e9
"""No length or angle of an arm is larger in any unit."""
_KEYS = ("a", "alpha", "d", "theta", "beta", "name", "kind", "lower", "upper")


def parse_dh(text: str, source: str) -> StandardDH | ModifiedDH:
    """The chain of a table. Raises: InputError naming the file, the joint and the key that is missing or wrong."""
    try:
        data = parse_yaml(text)
    except InputError as error:
        raise InputError(f"{source}: not YAML ({error})") from error
    if not isinstance(data, Mapping) or not isinstance(data.get("joints"), list) or not data["joints"]:
        raise InputError(f"{source}: no list of joints; expected the keys convention, units, joints of a DH table")
    convention = data.get("convention")
    if not isinstance(convention, str) or convention not in CONVENTIONS:
        raise InputError(f"{source}: convention is {convention!r}, expected {' or '.join(CONVENTIONS)} (Craig's)")
    units = data.get("units")
    if (
        not isinstance(units, Mapping)
        or str(units.get("length")) not in _LENGTHS
        or str(units.get("angle")) not in _ANGLES
    ):
        raise InputError(f"{source}: units is {units!r}, expected {{length: m or mm, angle: rad or deg}}")
    length, angle = _LENGTHS[units["length"]], _ANGLES[units["angle"]]
    note_unused(source, (str(key) for key in data if key not in ("convention", "units", "joints", "name")))
    rows, joints = zip(
        *(_dh_row(e, f"{source}: joint {i}", length, angle, i) for i, e in enumerate(data["joints"], start=1))
    )
    return CONVENTIONS[convention](rows, joints)


def dh_text(chain: DHChain) -> str:
    """The table as YAML text in metres and radians, digits enough to read back the same numbers."""
    convention = next(name for name, kind in CONVENTIONS.items() if isinstance(chain, kind))
    joints: list[dict[str, Any]] = []
    for row, joint in zip(chain.rows, chain.joints):
        entry: dict[str, Any] = {"name": joint.name, "a": row.a, "alpha": row.alpha, "d": row.d, "theta": row.theta}
        if row.beta != 0.0:
            entry["beta"] = row.beta
        if joint.kind != "revolute":
            entry["kind"] = joint.kind
        joints.append({**entry, "lower": joint.lower, "upper": joint.upper})
    data = {"convention": convention, "units": {"length": "m", "angle": "rad"}, "joints": joints}
    return yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=200)


def _dh_row(entry: Any, where: str, length: float, angle: float, index: int) -> tuple[DHRow, Joint]:
    if not isinstance(entry, Mapping):
        raise InputError(f"{where} is {entry!r}, expected the keys a, alpha, d, theta")
    unknown = [str(k) for k in entry if k not in _KEYS]
    if unknown:
        raise InputError(f"{where}: unknown key {unknown[0]!r}; known: {', '.join(_KEYS)}")
    name, kind = str(entry.get("name", f"joint_{index}")), entry.get("kind", "revolute")
    if kind not in ("revolute", "prismatic"):
        raise InputError(f"{where}: kind is {kind!r}, expected revolute or prismatic")
    unit = angle if kind == "revolute" else length
    row = DHRow(
        a=_dh_number(entry, "a", where) * length,
        alpha=_dh_number(entry, "alpha", where) * angle,
        d=_dh_number(entry, "d", where) * length,
        theta=_dh_number(entry, "theta", where, 0.0) * angle,
        beta=_dh_number(entry, "beta", where, 0.0) * angle,
    )
    missing = None if kind == "prismatic" else math.pi / unit
    lower = _dh_number(entry, "lower", where, None if missing is None else -missing, endless=True) * unit
    upper = _dh_number(entry, "upper", where, missing, endless=True) * unit
    if not lower < upper:
        raise InputError(f"{where} ({name}): limits {lower / unit:g} to {upper / unit:g}; the lower comes first")
    return row, Joint(name, lower, upper, kind)


def _dh_number(
    entry: Mapping[Any, Any], key: str, where: str, default: float | None = None, *, endless: bool = False
) -> float:
    value = entry.get(key, default)
    if value is None:
        raise InputError(f"{where}: no {key}; it has {', '.join(map(str, entry))}")
    if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
        raise InputError(f"{where}: {key} is {value!r}, expected a number")
    if not endless and not abs(value) < _LARGEST:
        raise InputError(f"{where}: {key} is {value!r}, expected a finite number")
    return float(value)
