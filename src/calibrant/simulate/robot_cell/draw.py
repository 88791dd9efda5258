"""What a seed decides: how cameras are mounted and ground, where things lie, the light. A stream of random numbers for
each part, so that two cells of one seed differ in nothing but in what their specs differ."""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.simulate.robot_cell.model import SHEET_M
from calibrant.simulate.robot_cell.parts.noise import CellSpread
from calibrant.simulate.robot_cell.parts.spec import CellCamera, CellObject, RobotCellSpec
from calibrant.simulate.robot_cell.pictures.camera import TrueCamera
from calibrant.simulate.robot_cell.world.light import Light
from calibrant.targets.registry import parse_target

_MIDDLE = np.array([0.48, 0.0])
"""Of the part of the table where things are put, metres: in the arm's reach and in all cameras' view."""
_APART_M = 0.07
"""Between the middles of two things, beyond their half sizes: the open fingers fit between them."""


def stream(seed: int, part: str) -> np.random.Generator:
    """Random numbers of one part of the cell."""
    return np.random.default_rng([seed, *part.encode()])


def drawn_light(spread: CellSpread, rng: np.random.Generator) -> Light:
    """A lamp above, from a side."""
    lean = 2.0 * spread.light * rng.standard_normal(2)
    direction = np.array([lean[0] + 0.15, lean[1] + 0.1, -1.0])
    strength = np.clip(1 + spread.light * rng.standard_normal(), 0.85, 1.1)
    return Light(direction / np.linalg.norm(direction), 0.60 * strength, 0.50 * strength)


def drawn_camera(spec: CellCamera, spread: CellSpread, rng: np.random.Generator) -> tuple[TrueCamera, Array]:
    """The camera as it was built, and its true T_parent_camera."""
    mm, deg = (spread.wrist_mm, spread.wrist_deg) if spec.parent == "gripper" else (spread.fixed_mm, spread.fixed_deg)
    scale = np.repeat([np.deg2rad(deg), 1e-3 * mm], 3)
    T_parent_camera = se3.retract(spec.T_parent_camera, scale * rng.standard_normal(6))
    colour = _ground_lens(spec.colour, spread, rng)
    # The maker rectifies depth pictures: what remains of their focal length is part of the disparity's offset.
    offset = spec.depth_noise.offset_px * float(rng.standard_normal())
    turned = se3.retract(spec.T_colour_depth, np.repeat([1e-3, 2e-4], 3) * (spread.focal_percent > 0) * _normal(rng, 6))
    return TrueCamera(colour, spec.depth, turned, offset), T_parent_camera


def _normal(rng: np.random.Generator, count: int) -> Array:
    return rng.standard_normal(count)


def _ground_lens(stated: Camera, spread: CellSpread, rng: np.random.Generator) -> Camera:
    values, width = stated.parameters, stated.image_size[0]
    scale = 1 + 0.01 * spread.focal_percent * rng.standard_normal()
    aspect = 1 + 0.001 * spread.focal_percent * rng.standard_normal()
    shift = spread.centre_px * width / 640 * rng.standard_normal(2)
    true = {
        "fx": values["fx"] * scale,
        "fy": values["fy"] * scale * aspect,
        "cx": values["cx"] + shift[0],
        "cy": values["cy"] + shift[1],
        "k1": values.get("k1", 0.0) + spread.radial * rng.standard_normal(),
        "p1": values.get("p1", 0.0) + 0.01 * spread.radial * rng.standard_normal(),
        "p2": values.get("p2", 0.0) + 0.01 * spread.radial * rng.standard_normal(),
    }
    return Camera.create("brown", true, image_size=stated.image_size)


def drawn_places(spec: RobotCellSpec, rng: np.random.Generator) -> dict[str, Array]:
    """T_base_object of every thing that is present: as given, or on the table, apart from each other, turned at random.

    Raises: InputError when the table is too small for all.
    """
    placed: dict[str, Array] = {}
    taken: list[tuple[Array, float]] = []
    for item in spec.objects:
        if not item.present or item.T_base_object is None:
            continue
        T = se3.check(item.T_base_object, name=f"T_base_object of {item.name}")
        placed[item.name] = T
        taken.append((T[:2, 3], _radius(item)))
    for item in spec.objects:
        if not item.present or item.T_base_object is not None:
            continue
        placed[item.name] = _free_place(item, spec, taken, rng)
    return placed


def _free_place(
    item: CellObject, spec: RobotCellSpec, taken: list[tuple[Array, float]], rng: np.random.Generator
) -> Array:
    radius = _radius(item)
    for attempt in range(2000):
        # The place grows where it is full.
        half = (spec.spread.objects_m + 0.03) * np.array([0.7, 1.3]) * (1 + attempt / 1000)
        middle = _MIDDLE + rng.uniform(-half, half)
        if np.linalg.norm(middle) < 0.3:  # the arm cannot look down there
            continue
        belt = spec.conveyor
        if belt is not None and abs(middle[0] - belt.x_m) < belt.width_m / 2 + radius + 0.01:
            continue
        if all(np.linalg.norm(middle - other) > radius + r + _APART_M for other, r in taken):
            taken.append((middle, radius))
            return lying_at(item, float(middle[0]), float(middle[1]), yaw=float(rng.uniform(-np.pi, np.pi)))
    raise InputError(
        f"there is no room on the table for {item.name}; take fewer or smaller things, or give their places"
    )


def lying_at(item: CellObject, x: float, y: float, *, yaw: float = 0.0, z: float = 0.0) -> Array:
    """T_base_object of a thing that lies with its middle at (x, y), on a plane at height z; radians, metres."""
    turn = so3.exp([0, 0, yaw])
    if item.size is not None:
        return se3.make(turn, [x, y, z + item.size[2] / 2])
    face_up = turn @ np.diag([1.0, -1.0, -1.0])  # a target's z goes into the sheet
    x0, y0, x1, y1 = parse_target(str(item.target)).artwork().bounds
    middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2, 0.0])
    return se3.make(face_up, np.array([x, y, z + SHEET_M]) - face_up @ middle)


def _radius(item: CellObject) -> float:
    """Of the circle around a thing seen from above, metres."""
    if item.size is not None:
        return 0.5 * float(np.hypot(item.size[0], item.size[1]))
    x0, y0, x1, y1 = parse_target(str(item.target)).artwork().bounds
    return 0.5 * float(np.hypot(x1 - x0, y1 - y0))
