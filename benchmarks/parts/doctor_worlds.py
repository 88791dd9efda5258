"""Hand-eye data sets as people bring them, drawn at random with their truth: cells, cameras, targets, noise, moves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from doctor import Sample
from numpy.typing import NDArray

from calibrant.calibrate.intrinsics.one_model import calibrate_keeping
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.cameras import Camera
from calibrant.data import Observations
from calibrant.errors import CalibrantError, InputError
from calibrant.geometry import se3, so3
from calibrant.robots.arms import ARMS
from calibrant.robots.geometry import ParametricChain
from calibrant.simulate.arm import choose_views
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.scenes import Setup, gripper_poses, look_at_board, observe, standard_mounting
from calibrant.simulate.scenes import target_poses as poses_of_targets
from calibrant.targets.registry import parse_target

Array = NDArray[np.float64]
Source = Literal["target poses", "known camera", "own camera"]

TARGETS = (
    "chessboard:9x6:25mm",
    "charuco:5x7:36mm:18mm:DICT_6X6_250",
    "circles:4x11:20mm:asymmetric",
    "circles:7x7:20mm",
)
SOURCES: tuple[Source, ...] = ("target poses", "known camera", "own camera")
SENSORS = ((640, 480), (1280, 1024), (1920, 1080), (2448, 2048))
MOUNTING = np.array([0.3, 0.3, 0.3, 0.04, 0.04, 0.04])
"""Radians and metres by which cells differ from the ordinary one (1 sigma)."""


@dataclass(frozen=True, eq=False)
class World:
    """A data set and its truth: T_base_gripper (n, 4, 4) as reported, T_camera_target B (n, 4, 4) true, A X B = Z.

    sigma_px: noise of the points, drawn from `seed`; sigma_mm, sigma_deg: white noise of the robot.
    """

    setup: Setup
    spec: str
    points: Array
    camera: Camera
    source: Source
    X: Array
    Z: Array
    reported: Array
    B: Array
    sigma_px: float
    sigma_mm: float
    sigma_deg: float
    seed: int
    words: str

    def __len__(self) -> int:
        return len(self.B)

    @property
    def ids(self) -> tuple[str, ...]:
        """Names of the pictures."""
        return tuple(f"{i}.png" for i in range(len(self)))

    def sample(self, *, B: Array | None = None) -> Sample:
        """What is measured, always with the same noise, with the target at B (n, 4, 4), by default where it is."""
        B, rng = self.B if B is None else B, np.random.default_rng(self.seed)
        seen = observe(self.camera, self.points, B, sigma_px=self.sigma_px, rng=rng)
        views = tuple(replace(v, id=i, moment=i) for v, i in zip(seen.views, self.ids))
        if self.spec.startswith("charuco"):
            views = tuple(v.subset(_in_part(v.uv, rng)) for v in views)
        observations = Observations(views, seen.image_sizes)
        if self.source == "target poses":
            return Sample(self.setup, self.ids, self.reported, B=target_poses(self.camera, views).T_camera_target)
        if self.source == "known camera":
            return Sample(self.setup, self.ids, self.reported, observations=observations, camera=self.camera)
        kept = calibrate_keeping(observations)
        observations = replace(observations, views=kept.views)
        return Sample(self.setup, self.ids, self.reported, observations=observations, camera=kept.result.camera)

    def moving(self, B: Array, rng: np.random.Generator) -> World:
        """The same cell with the robot where the target is seen at B (k, 4, 4)."""
        T = gripper_poses(self.setup, self.X, self.Z, B)
        return replace(self, reported=noisy_poses(T, sigma_mm=self.sigma_mm, sigma_deg=self.sigma_deg, rng=rng), B=B)


def draw_world(rng: np.random.Generator, *, source: Source | None = None, least: int = 6) -> World:
    """A cell, its camera and target, `least` to 40 poses, and how well they are measured."""
    source = source or SOURCES[rng.integers(len(SOURCES))]
    while True:
        setup: Setup = ("eye-in-hand", "eye-to-hand")[rng.integers(2)]  # type: ignore[assignment]
        spec = str(rng.choice(TARGETS))
        points = parse_target(spec).points * rng.uniform(0.7, 2.0)
        camera = draw_camera(rng)
        X, Z = (se3.retract(T, MOUNTING * rng.standard_normal(6)) for T in standard_mounting(setup))
        n = int(rng.integers(least, 41))
        mm, deg, px = _log_uniform(rng, 0.01, 1.0), _log_uniform(rng, 0.002, 0.2), _log_uniform(rng, 0.05, 1.0)
        try:
            T, B, words = _views(rng, setup, X, Z, camera, points, n, mm, deg)
        except CalibrantError:  # out of the arm's reach, or the board does not fit: another cell
            continue
        order = _along_a_path(T) if rng.random() < 0.5 else np.arange(n)
        T = noisy_poses(T[order], sigma_mm=mm, sigma_deg=deg, rng=rng)
        words = f"{setup}, {n} poses, {spec}, {source}, {words}, {mm:.2g} mm, {deg:.2g} deg, {px:.2g} px"
        return World(
            setup, spec, points, camera, source, X, Z, T, B[order], px, mm, deg, int(rng.integers(2**32)), words
        )  # fmt: skip


def draw_camera(rng: np.random.Generator) -> Camera:
    """A lens of 30 to 90 degrees with its distortion, which it has all over the picture."""
    width, height = SENSORS[rng.integers(len(SENSORS))]
    corners = np.array([[0, 0], [width, 0], [0, height], [width, height]])
    while True:
        f = 0.5 * width / np.tan(0.5 * np.deg2rad(rng.uniform(30, 90)))
        centre = np.array([width, height]) * rng.uniform(0.47, 0.53, 2)
        k1 = rng.uniform(-0.3, 0.05)
        parameters = {"fx": f, "fy": f * rng.uniform(0.998, 1.002), "cx": centre[0], "cy": centre[1]}
        distortion = {"k1": k1, "k2": -0.4 * k1 * rng.uniform(0, 1), "p1": 3e-4, "p2": -3e-4, "k3": 0.0}
        camera = Camera.create("brown", parameters | distortion, image_size=(width, height))
        if np.isfinite(camera.unproject(corners)).all():
            return camera


def about_one_axis(w: World, rng: np.random.Generator) -> World:
    """Every turn is about one direction, as a SCARA's are."""
    axis = rng.standard_normal(3)
    turns = rng.uniform(-0.4, 0.4, (len(w), 1)) * axis / np.linalg.norm(axis)
    return w.moving(_turned(w, rng, so3.exp(turns)), rng)


def without_turns(w: World, rng: np.random.Generator) -> World:
    """The robot translates only."""
    return w.moving(_turned(w, rng, np.tile(np.eye(3), (len(w), 1, 1))), rng)


def by_five_joints(w: World, rng: np.random.Generator) -> World:
    """An arm that swings about its base, lifts its gripper in that plane and rolls it: the views it reaches, if any."""
    n = 40_000
    where = w.reported[rng.integers(len(w), size=n), :3, 3] + rng.uniform(-0.1, 0.1, (n, 3))
    swing, roll = np.arctan2(where[:, 1], where[:, 0]), rng.uniform(-np.pi, np.pi, n)
    lift = np.pi + rng.uniform(-0.8, 0.8, n)
    R = np.eye(3)
    for angle, axis in ((swing, [0, 0, 1]), (lift, [0, 1, 0]), (roll, [0, 0, 1])):
        R = R @ so3.exp(angle[:, None] * np.array(axis))
    seen = _in_view(w, poses_of_targets(w.setup, w.X, w.Z, se3.make(R, where)))
    return w.moving(seen[: len(w)], rng)


def _turned(w: World, rng: np.random.Generator, R: Array) -> Array:
    """Target poses of the first view turned by R (n, 3, 3) about the board's middle, which moves by a tenth."""
    middle = 0.5 * (w.points.min(axis=0) + w.points.max(axis=0))
    first = w.B[0]
    centre = se3.apply(first, middle) * np.array([0.3, 0.3, 1.3])
    centre = centre + 0.1 * centre[2] * rng.uniform(-1, 1, (len(R), 3))
    R = R @ first[:3, :3]
    return se3.make(R, centre - R @ middle)


def _in_view(w: World, B: Array) -> Array:
    """Target poses in which the camera sees the whole board from its front."""
    p = se3.apply(B[:, None], w.points)
    near = np.all(p[..., 2] > 0.1, axis=1) & (B[:, 2, 2] > 0.5) & (p[..., 2].max(axis=1) < 2 * w.B[:, 2, 3].max())
    B, p = B[near], p[near]
    uv = w.camera.project(p)
    with np.errstate(invalid="ignore"):
        return B[np.all((uv > 2) & (uv < np.array(w.camera.image_size) - 3), axis=(1, 2))]


def _views(
    rng: np.random.Generator,
    setup: Setup,
    X: Array,
    Z: Array,
    camera: Camera,
    points: Array,
    n: int,
    mm: float,
    deg: float,
) -> tuple[Array, Array, str]:
    """T_base_gripper as the controller believes and T_camera_target, without white noise, and words about the arm."""
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    near = size * camera.parameters["fx"] / camera.image_size[1]
    distance = (1.2 * near, rng.uniform(1.6, 3.0) * near)
    tilt = float(rng.uniform(20, 45))
    if rng.random() < 0.5:
        B = look_at_board(
            camera, points, n, rng=rng, distance=distance, tilt_deg=tilt, roll_deg=float(rng.uniform(30, 180))
        )
        return gripper_poses(setup, X, Z, B), B, "any robot"
    name = str(rng.choice(list(ARMS)))
    chain = ARMS[name]
    some = gripper_poses(setup, X, Z, look_at_board(camera, points, 40, rng=rng, distance=distance, tilt_deg=tilt))
    reach = np.linalg.norm(chain.forward(np.zeros(6))[:3, 3])
    if np.mean(np.linalg.norm(some[:, :3, 3], axis=1) < 0.9 * reach) < 0.8:
        raise InputError("most of the views are out of the arm's reach")
    taken = choose_views(chain, camera, points, n, setup=setup, X=X, Z=Z, rng=rng, distance=distance, tilt_deg=tilt)
    if not isinstance(chain, ParametricChain) or rng.random() < 0.5:
        return taken.T_base_gripper, taken.T_camera_target, name
    # The controller believes its nominal geometry; each parameter is off by about as much as the white noise.
    scale = np.array([1e-3 * mm if p.unit == "m" else np.deg2rad(0.3 * deg) for p in chain.parameters])
    believed = chain.moved(scale * rng.standard_normal(len(scale))).forward(taken.q)
    return believed, taken.T_camera_target, f"{name} with errors of geometry"


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _in_part(uv: Array, rng: np.random.Generator) -> NDArray[np.bool_]:
    """A ChArUco board is found in part too: now and then the edge of the picture or a cable hides up to half of it."""
    if rng.random() < 0.7:
        return np.ones(len(uv), dtype=bool)
    angle = rng.uniform(0, 2 * np.pi)
    along = uv @ np.array([np.cos(angle), np.sin(angle)])
    return np.asarray(along <= np.quantile(along, rng.uniform(0.5, 1.0)))


def _along_a_path(T: Array) -> NDArray[np.intp]:
    """Neighbours follow one another, as when somebody moves the robot by hand."""
    left, path = list(range(1, len(T))), [0]
    while left:
        here = T[path[-1]]
        gaps = [np.linalg.norm(T[i][:3] - here[:3]) for i in left]
        path.append(left.pop(int(np.argmin(gaps))))
    return np.array(path)
