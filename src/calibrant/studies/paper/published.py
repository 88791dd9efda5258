"""What the paper prints: the cuboid's pose in the camera (table 1) and in the base (table 2), means of six readings.

Series 1: camera place P, the cuboid at A, B, C. Series 2: camera places P, Q, R, the cuboid at A. Numbers are mm and
degrees; the order and the axes of the three angles are not named. No truth is printed, so that only distances can be
compared: a camera that stands still is tied to the base by a rigid map, which keeps them, and a cuboid that stands
still is one point in the base.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np

from calibrant.arrays import Array

Table: TypeAlias = Mapping[str, tuple[float, float, float, float, float, float]]

CAMERA: Table = {
    "PA": (4.8466, 28.932, 210.792, 0.0, 0.0, 1.169),
    "PB": (-15.276, 1.555, 211.520, 0.0, 0.0, 178.685),
    "PC": (-45.253, 28.462, 212.947, 0.0, 0.0, 1.099),
    "QA": (5.7487, -59.275, 212.372, 0.0, 0.0, 0.135),
    "RA": (44.643, -18.897, 210.147, 0.0, 0.0, -179.709),
}
BASE: Table = {
    "PA": (137.204, 501.147, 234.588, 178.897, -0.822, 0.880),
    "PB": (116.919, 531.519, 233.567, 178.861, -0.812, -178.977),
    "PC": (87.0767, 501.337, 233.149, 178.896, -0.823, 0.809),
    "QA": (137.593, 493.782, 231.337, 178.900, -0.821, -0.157),
    "RA": (133.991, 497.923, 233.874, -178.913, 0.822, -179.991),
}
FIXED, MOVED = ("PA", "PB", "PC"), ("QA", "RA")
"""Rows of the series whose camera stands still, and of the other those whose camera has moved."""
ROWS = (*FIXED, *MOVED)
STILL_PAIRS = (("PA", "PB"), ("PB", "PC"), ("PA", "PC"))
"""Of a camera that stands still: the same distance in both frames."""
SAME_PAIRS = (("PA", "QA"), ("PA", "RA"), ("QA", "RA"))
"""Of a cuboid that stands still: no distance in the base."""
PAIRS = (*STILL_PAIRS, *SAME_PAIRS)
PLANE_MM = 220.0
"""The camera's height above the plane on which the cuboid lies (figure 17)."""
SIDES_M = (0.054, 0.037, 0.005)


def place(table: Table, row: str) -> Array:
    """(3,) mm."""
    return np.array(table[row][:3])


def distance_mm(table: Table, pair: tuple[str, str]) -> float:
    """Between two rows.

    >>> round(distance_mm(CAMERA, ("PA", "PB")), 3), round(distance_mm(BASE, ("PA", "PB")), 3)
    (33.985, 36.537)
    """
    return float(np.linalg.norm(place(table, pair[0]) - place(table, pair[1])))


def contradiction_mm() -> float:
    """The most that a distance between two places of the cuboid differs between the paper's two frames.

    >>> round(contradiction_mm(), 2)
    2.55
    """
    return max(abs(distance_mm(CAMERA, pair) - distance_mm(BASE, pair)) for pair in STILL_PAIRS)


def scatter_mm() -> float:
    """The most that the cuboid, which stands still, lies apart in the base by the paper's table 2.

    >>> round(scatter_mm(), 2)
    8.06
    """
    return max(distance_mm(BASE, pair) for pair in SAME_PAIRS)


def turn_deg(table: Table, pair: tuple[str, str]) -> float:
    """How far the third angle turns between two rows, modulo the half turn after which the cuboid looks the same.

    >>> round(turn_deg(BASE, ("PA", "QA")), 2)
    1.04
    """
    off = table[pair[1]][5] - table[pair[0]][5]
    return abs((off + 90.0) % 180.0 - 90.0)
