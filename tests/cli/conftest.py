"""A small simulated cell, photographed once, and the command line run in this process."""

from __future__ import annotations

import contextlib
import hashlib
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibrant.cameras import Camera
from calibrant.cli.application import run
from calibrant.data import RobotPoses
from calibrant.simulate.cell import poses_csv
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import gripper_poses, look_at_board, standard_mounting
from calibrant.targets.registry import parse_target

TARGET = "chessboard:7x6:30mm"
VIEWS = 8


@dataclass(frozen=True)
class Outcome:
    """What a command left behind on its two streams, and its exit status."""

    status: int
    out: str
    err: str


@dataclass(frozen=True)
class Cell:
    """Photos NN.png of TARGET in `images`, robot poses in `poses`; the truth X = T_gripper_camera."""

    images: Path
    poses: Path
    X: np.ndarray
    camera: Camera

    @property
    def photos(self) -> list[str]:
        return [str(p) for p in sorted(self.images.iterdir())]


def calibrant(*arguments: object) -> Outcome:
    """The command line with these arguments, in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = run([str(a) for a in arguments])
    return Outcome(status, out.getvalue(), err.getvalue())


@pytest.fixture(scope="session", name="calibrant")
def _calibrant() -> Callable[..., Outcome]:
    return calibrant


@pytest.fixture(scope="session")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Cell:
    folder = tmp_path_factory.mktemp("a cell")  # a space in the name, as people have
    images = folder / "images"
    images.mkdir()
    rng = np.random.default_rng(7)
    camera = Camera.create(
        "brown", {"fx": 430.0, "fy": 428.0, "cx": 241.0, "cy": 178.0, "k1": -0.1}, image_size=(480, 360)
    )
    target = parse_target(TARGET)
    T = look_at_board(camera, target.points, VIEWS, rng=rng, distance=(0.35, 0.6), tilt_deg=45)
    X, Z = standard_mounting("eye-in-hand")
    for i, T_camera_target in enumerate(T):
        image = render(target.artwork(), camera, T_camera_target, rng=rng, look=Look(clutter=0, noise_grey=2.0))
        cv2.imwrite(str(images / f"{i:02d}.png"), image)
    robot = noisy_poses(gripper_poses("eye-in-hand", X, Z, T), sigma_mm=0.05, sigma_deg=0.01, rng=rng)
    names = [f"{i:02d}.png" for i in range(VIEWS)]
    poses = folder / "poses.csv"
    poses.write_text(poses_csv(RobotPoses.from_matrices(robot, ids=names)))
    return Cell(images, poses, X, camera)


@pytest.fixture
def untouched(cell: Cell) -> Callable[[], None]:
    """A function that fails when a file of the cell has changed, come or gone since the test began."""

    def state() -> dict[str, str]:
        files = [p for p in cell.poses.parent.rglob("*") if p.is_file()]
        return {str(p): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}

    before = state()

    def check() -> None:
        assert state() == before

    return check


@pytest.fixture(scope="session")
def found(cell: Cell, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The cell's points in an observations file: what `calibrant detect` writes."""
    path = tmp_path_factory.mktemp("found") / "observations.json"
    assert calibrant("detect", cell.images, "--target", TARGET, "--out", path, "-q") == Outcome(0, "", "")
    return path
