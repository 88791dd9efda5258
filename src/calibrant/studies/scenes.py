"""What `calibrant study methods` feeds to the methods: views of a plane and of a target with depth, and their truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cameras import Camera, camera_model
from calibrant.data import Observations, View
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import grid, observe

IMAGE_SIZE = (1280, 1024)
FOCAL_PX = 1000.0
SPACING = 0.03
DISTANCE = (0.5, 0.7)
ASIDE = (0.02, 0.07)
"""|t_x| and |t_y| of a target's origin, metres: on neither of the axes on which a method divides by zero."""
LEAST_POINTS = 9


@dataclass(frozen=True)
class Conditions:
    """A synthetic scene: what the methods' errors depend on.

    points: of the target, about; only: keep this many, drawn at random, of each view; tilt_deg: range of the tilts;
    depth: of the target with depth, 1 for two boards at right angles, 0 for one board; t_y_mm: of the target's origin,
    drawn when None; centre_error_px: how far the principal point lies from where the methods take it to be; lens: a
    camera model, or a model with its first radial term.
    """

    seed: int = 0
    noise_px: float = 0.1
    points: int = 63
    views: int = 6
    only: int | None = None
    tilt_deg: tuple[float, float] = (25.0, 45.0)
    depth: float = 1.0
    t_y_mm: float | None = None
    centre_error_px: float = 0.0
    lens: str = "brown:-0.1"


@dataclass(frozen=True, eq=False)
class Case:
    """Views of one target by one camera, what the methods are told of it, and the truth where it is known.

    centre (2,) px and aspect are given to the methods that take them as known; T_camera_target (m, 4, 4).
    """

    views: tuple[View, ...]
    image_size: tuple[int, int]
    centre: Array
    aspect: float
    camera: Camera | None = None
    T_camera_target: Array | None = None

    @property
    def observations(self) -> Observations:
        """The views as the calibrating functions take them."""
        return Observations(self.views, {v.camera: self.image_size for v in self.views})

    def view(self, index: int) -> Case:
        """The case of one view alone."""
        T = None if self.T_camera_target is None else self.T_camera_target[index : index + 1]
        return Case(self.views[index : index + 1], self.image_size, self.centre, self.aspect, self.camera, T)


def lens_of(spec: str, *, centre: Array) -> Camera:
    """A camera of FOCAL_PX from MODEL or MODEL:TERM, such as pinhole, brown:-0.1, division:-0.1.

    Raises: InputError for an unknown model, or a term where the model has none.
    """
    name, _, term = spec.partition(":")
    kind = camera_model(name)
    parameters = {"fx": FOCAL_PX, "fy": FOCAL_PX, "cx": float(centre[0]), "cy": float(centre[1])}
    if term:
        try:
            value = float(term)
        except ValueError:
            value = float("nan")
        if len(kind.parameter_names) < 5 or kind.parameter_names[4] not in ("k1", "l1") or not np.isfinite(value):
            raise InputError(
                f"--lens {spec}: expected a model with a radial term and its value, such as brown:-0.1, division:-0.1, "
                "inverse_brown:0.1, or pinhole alone"
            )
        parameters[kind.parameter_names[4]] = value
    return Camera.create(name, parameters, image_size=IMAGE_SIZE)


def plane_points(count: int) -> Array:
    """A board of about `count` points, 30 mm apart, with odd numbers of columns and rows about its origin (n, 3)."""
    rows = max(3, 2 * int(np.sqrt(count * 7 / 9) / 2) + 1)
    columns = max(3, 2 * int(count / rows / 2) + 1)
    points = grid(columns, rows, SPACING)
    return points - points.mean(axis=0)


def solid_points(count: int, *, depth: float) -> Array:
    """Two boards that meet at the y axis, at right angles for a depth of 1, as slide 64's setup (n, 3)."""
    board = plane_points(max(count // 2, LEAST_POINTS))
    along = board[:, 0] - board[:, 0].min() + 0.5 * SPACING
    side = np.sqrt(0.5) * along
    left, right = (np.column_stack([sign * side, board[:, 1], depth * side]) for sign in (-1, 1))
    points = np.concatenate([left, right])
    return np.asarray(points - [0, 0, points[:, 2].mean()])


def plane_case(conditions: Conditions) -> Case:
    """Views of a board."""
    return _case(plane_points(conditions.points), conditions)


def solid_case(conditions: Conditions) -> Case:
    """Views of two boards at an angle."""
    return _case(solid_points(conditions.points, depth=conditions.depth), conditions)


def observed_case(found: Observations) -> Case:
    """Views of a real target: the principal point taken to be the image's middle, pixels square.

    Raises: InputError for several cameras, or no views.
    """
    if len(found.image_sizes) != 1 or not found.views:
        raise InputError(
            f"the study takes views of one camera, got {len(found.views)} views of {len(found.image_sizes)} cameras"
        )
    size = next(iter(found.image_sizes.values()))
    return Case(found.views, size, (np.array(size, dtype=np.float64) - 1) / 2, 1.0)


def _case(points: Array, conditions: Conditions) -> Case:
    rng = np.random.default_rng(conditions.seed)
    told = (np.array(IMAGE_SIZE, dtype=np.float64) - 1) / 2
    around = rng.uniform(0, 2 * np.pi)
    centre = told + conditions.centre_error_px * np.array([np.cos(around), np.sin(around)])
    camera = lens_of(conditions.lens, centre=centre)
    T = np.stack([_board_pose(conditions, rng) for _ in range(conditions.views)])
    seen = observe(camera, points, T, sigma_px=conditions.noise_px, rng=rng)
    views = seen.views
    if conditions.only is not None:
        views = tuple(v.subset(_some(len(v), conditions.only, rng)) for v in views)
    return Case(views, IMAGE_SIZE, told, 1.0, camera, T)


def _board_pose(conditions: Conditions, rng: np.random.Generator) -> Array:
    tilt, around = np.deg2rad(rng.uniform(*conditions.tilt_deg)), rng.uniform(0, 2 * np.pi)
    R = so3.exp(tilt * np.array([np.cos(around), np.sin(around), 0])) @ so3.exp([0, 0, rng.uniform(-np.pi, np.pi)])
    x, y = rng.uniform(*ASIDE, 2) * rng.choice([-1.0, 1.0], 2)
    if conditions.t_y_mm is not None:
        y = 1e-3 * conditions.t_y_mm
    return se3.make(R, [x, y, rng.uniform(*DISTANCE)])


def _some(n: int, keep: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    chosen = np.zeros(n, dtype=np.bool_)
    chosen[rng.permutation(n)[:keep]] = True
    return chosen
