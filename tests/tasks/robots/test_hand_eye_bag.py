"""Hand-eye and clocks from bags: what the files give, whatever the clocks differ by, and pictures on the move."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline
from tests.made_bags import written_bag

import calibrant as cb
from calibrant.cameras import Camera
from calibrant.geometry import rotations, se3
from calibrant.geometry.motion import Motion
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import gripper_poses, look_at_board, standard_mounting
from calibrant.targets.registry import parse_target

SPEC = "charuco:5x7:36.195mm:18.256mm:DICT_6X6_250"
BOARD = "chessboard:7x6:30mm"
OFFSET = 0.037
CAMERA = Camera.create(
    "brown", {"fx": 300.0, "fy": 299.0, "cx": 162.5, "cy": 117.5, "k1": -0.05}, image_size=(320, 240)
)


def rct_bag(folder: Path, source: Path, kind: str, offset: float) -> Path:
    """The real set as a bag: each pose held for a second, moves of a second between, three pictures of each hold."""
    photos = sorted((source / "images").glob("*.png"), key=lambda p: int(p.stem))
    T = []
    for photo in photos:
        pose = yaml.safe_load((source / "poses" / f"{photo.stem}.yaml").read_text())
        q = np.array([pose[f"q{axis}"] for axis in "xyzw"])
        T.append(se3.make(rotations.matrix_from_quaternion_xyzw(q), [pose[axis] for axis in "xyz"]))
    motion = Motion(np.arange(2.0 * len(T)), np.repeat(np.stack(T), 2, axis=0))
    with written_bag(folder, kind) as (bag, writer):
        for k, photo in enumerate(photos):
            for t in np.arange(2.0 * k, 2.0 * k + 2.0, 0.02):
                writer.transforms("/tf", {("base_link", "tool0"): motion.at([t])[0]}, t)
            picture = cv2.imread(str(photo))
            for part in (0.2, 0.5, 0.8):
                t = 2.0 * k + part
                writer.compressed("/camera/image_raw/compressed", picture, t, stamp=t - offset)
    return bag


@pytest.mark.long
@pytest.mark.parametrize(("kind", "offset"), [("mcap", 0.0), ("ros1", OFFSET)])
def test_a_real_set_as_a_bag_gives_what_its_files_give(
    kind: str, offset: float, shared_data: Callable[[str], Path], tmp_path: Path
) -> None:
    folder = shared_data("handeye_rct_charuco_static")
    files = cb.hand_eye(images=folder / "images", poses=folder / "poses", target=SPEC)
    bag = rct_bag(tmp_path, folder, kind, offset)
    result = cb.hand_eye(bag=bag, image_topic="/camera/image_raw", tf="base_link:tool0", target=SPEC)
    assert len(result.views) == len(files.views) == 12
    for found, expected in zip(result.transforms, files.transforms, strict=True):
        assert (found.parent, found.child) == (expected.parent, expected.child)
        assert expected.covariance is not None
        # A decoder's grey and the grey of a decoded colour differ by their rounding.
        sigma = np.sqrt(np.diag(expected.covariance))
        assert np.all(np.abs(se3.local(expected.matrix, found.matrix)) < 0.05 * sigma)
    (record, *_) = result.inputs
    assert record["file"].endswith((".mcap", ".bag", ".yaml"))
    examined = cb.doctor(bag=bag, image_topic="/camera/image_raw", tf="base_link:tool0", target=SPEC)
    expected_of = cb.doctor(images=folder / "images", poses=folder / "poses", target=SPEC)
    assert (examined.verdict, examined.decided["setup"]) == (expected_of.verdict, expected_of.decided["setup"])
    assert examined.check("moments").message.startswith("12 still moments")
    assert examined.figures["loop_before_mm"].value == pytest.approx(
        expected_of.figures["loop_before_mm"].value, rel=0.02
    )
    assert {c.name for c in expected_of.checks} < {c.name for c in examined.checks}


def moving_bag(folder: Path, setup: str, *, seconds: float, seed: int) -> tuple[Path, NDArray]:
    """A camera and a robot that never stand still; the camera's clock is behind by OFFSET. And T of the camera."""
    rng = np.random.default_rng(seed)
    target = parse_target(BOARD)
    n = int(seconds) + 4
    seen = look_at_board(CAMERA, target.points, n, rng=rng, distance=(0.45, 0.65), tilt_deg=30, roll_deg=25)
    knots = np.arange(n) - 1.0
    turn = RotationSpline(knots, Rotation.from_matrix(seen[:, :3, :3]))
    place = CubicSpline(knots, seen[:, :3, 3])
    X, Z = standard_mounting(setup)  # type: ignore[arg-type]

    def board(t: float) -> NDArray:
        return se3.make(turn(t).as_matrix(), place(t))

    events = [(t, "tf") for t in np.arange(0.0, seconds + 0.5, 0.01)]
    events += [(t, "image") for t in np.arange(0.15, seconds, 1 / 15)]
    with written_bag(folder, "mcap") as (bag, writer):
        writer.camera_info("/camera/camera_info", CAMERA.K, [-0.05, 0, 0, 0, 0], CAMERA.image_size, 0.0)
        for t, what in sorted(events):
            if what == "tf":
                noise = 2e-5 * rng.standard_normal(6)
                T = gripper_poses(setup, X, Z, board(t)[None])[0]  # type: ignore[arg-type]
                writer.transforms("/tf", {("base_link", "tool0"): se3.retract(T, noise)}, t)
            else:
                picture = render(target.artwork(), CAMERA, board(t), rng=rng, look=Look(clutter=0, noise_grey=1.5))
                writer.image("/camera/image_raw", picture, t, "mono8", stamp=t - OFFSET)
    return bag, X


@pytest.mark.long
@pytest.mark.parametrize(("setup", "seed"), [("eye-in-hand", 3), ("eye-to-hand", 4)])
def test_on_the_move_the_offset_and_the_camera_are_found_within_their_sigma(
    setup: str, seed: int, tmp_path: Path
) -> None:
    bag, X = moving_bag(tmp_path, setup, seconds=8.0, seed=seed)
    clocks = cb.time_offset(
        bag=bag, tf="base_link:tool0", target=BOARD, setup=setup, camera="/camera/camera_info", workers=1
    )
    offset = clocks.figures["offset"]
    assert offset.sigma is not None
    assert offset.sigma <= 1e-3
    assert abs(offset.value - OFFSET) < 2 * offset.sigma
    result = cb.hand_eye(bag=bag, tf="base_link:tool0", target=BOARD, moments="moving", workers=1)
    covariance = result.transforms[0].covariance
    assert covariance is not None
    error = se3.local(result.transforms[0].matrix, X)
    assert float(error @ np.linalg.solve(covariance, error)) < 16.8  # 1 in 100 of 6 degrees of freedom
    assert any(c.name == "time-offset" for c in result.checks)
