"""The node on a transport that plays a robot: samples at its stands alone, a static transform, the live estimate."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from calibrant.cameras import Camera
from calibrant.data.result_file import read_result
from calibrant.geometry import se3, so3
from calibrant.ros.run import serve
from calibrant.ros.transport import Event, Info, Transform
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import gripper_poses, look_at_board, standard_mounting
from calibrant.targets.registry import parse_target
from calibrant.tasks.listener import Listener
from calibrant.tasks.live.camera_config import CameraConfig, Through
from calibrant.tasks.live.picture import Picture

TARGET = "chessboard:7x6:30mm"
CAMERA = Camera.create("brown", {"fx": 430.0, "fy": 428.0, "cx": 241.0, "cy": 178.0, "k1": -0.1}, image_size=(480, 360))
X, Z = standard_mounting("eye-in-hand")
_MIDDLE = se3.apply(Z, parse_target(TARGET).points.mean(axis=0))
_R = so3.exp([np.pi, 0, 0]) @ so3.exp([0.3, 0.2, 0.4])
T_BASE_FRONT = se3.make(_R, _MIDDLE - _R @ [0, 0, 0.5])
"""Half a metre from the board, turned by some twenty degrees, looking at its middle."""
RATE_S = 0.05


@dataclass
class Played:
    """A transport that gives what it is told, batch by batch, and keeps what is published."""

    batches: Iterator[Sequence[Event]]
    static: list[Transform] = field(default_factory=list)
    live: list[Transform] = field(default_factory=list)
    poses: list[tuple[Transform, np.ndarray]] = field(default_factory=list)
    shown: list[np.ndarray] = field(default_factory=list)
    closed: bool = False

    def events(self) -> Sequence[Event] | None:
        return next(self.batches, None)

    def publish_static(self, transform: Transform) -> None:
        self.static.append(transform)

    def publish_live(self, transform: Transform) -> None:
        self.live.append(transform)

    def publish_pose(self, transform: Transform, covariance: np.ndarray) -> None:
        self.poses.append((transform, covariance))

    def show(self, picture: np.ndarray, *, frame: str, stamp: float) -> None:
        self.shown.append(picture)

    def close(self) -> None:
        self.closed = True


class Heard(Listener):
    def __init__(self) -> None:
        self.notes: list[str] = []

    def note(self, text: str) -> None:
        self.notes.append(text)


def photo(T_camera_target: np.ndarray, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    artwork = parse_target(TARGET).artwork()
    return render(artwork, CAMERA, T_camera_target, rng=rng, look=Look(clutter=0, noise_grey=2.0))


def message(topic: str, grey: np.ndarray, stamp: float) -> Picture:
    height, width = grey.shape
    frame = topic.split("/")[1] + "_optical"
    return Picture(topic, stamp, frame, width, height, "mono8", width, grey.ravel())


def info(topic: str = "/wrist/camera_info") -> Info:
    terms = [CAMERA.parameters[k] for k in ("k1", "k2", "p1", "p2", "k3")]
    data = {"width": 480, "height": 360, "distortion_model": "plumb_bob", "d": terms, "k": CAMERA.K.ravel().tolist()}
    return Info(topic, data)


def stands(n: int, *, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """T_base_gripper and T_camera_target, (n, 4, 4) each."""
    rng = np.random.default_rng(seed)
    points = parse_target(TARGET).points
    seen = look_at_board(CAMERA, points, n, rng=rng, distance=(0.35, 0.6), tilt_deg=45)
    return gripper_poses("eye-in-hand", X, Z, seen), seen


def driven(A: np.ndarray, pictures: Sequence[dict[str, np.ndarray]]) -> Iterator[Sequence[Event]]:
    """tf at 20 Hz, a second on the way to each stand and one there, with a picture on the way and three at the end of
    the stand; the flange is a link below the arm's, which moves. tf comes a moment after the pictures of its time."""
    yield [info(), Transform("link6", "tool0", np.eye(4), 0.0, True)]
    stamp, before = 100.0, A[0]
    for T, taken in zip(A, pictures):
        delta = se3.local(before, T)
        steps = [se3.retract(before, s * delta) for s in np.linspace(0, 1, 21)] + [T] * 20
        for i, place in enumerate(steps):
            stamp += RATE_S
            if i == 10 or i >= 38:
                yield [message(topic, grey, stamp - 0.5 * RATE_S) for topic, grey in taken.items()]
            yield [Transform("base", "link6", place, stamp, False)]
        before = T


def config(folder: Path, **more: object) -> CameraConfig:
    given = {
        "name": "wrist", "ros": 1, "image": "/wrist/image", "base": "base", "tool": "tool0", "target": TARGET,
        "session": folder / "session", "camera_info": "/wrist/camera_info", "views": 8,
    }  # fmt: skip
    return CameraConfig(**{**given, **more})  # type: ignore[arg-type]


def test_a_wrist_camera_is_sampled_calibrated_and_published(tmp_path: Path) -> None:
    A, seen = stands(9)
    # The fourth stand is the third once more: nothing new, no sample.
    order = [0, 1, 2, 2, 3, 4, 5, 6, 7, 8]
    pictures = [{"/wrist/image": photo(seen[i], i)} for i in order]
    transport, heard = Played(driven(A[order], pictures)), Heard()
    outcome = serve(config(tmp_path), transport, heard)
    assert [n.split(":")[0] for n in heard.notes if "samples" in n] == [f"{i:04d}.png" for i in range(8)]
    assert {"the robot moves", "this pose is taken"} <= set(heard.notes)
    (published,) = transport.static
    assert (published.parent, published.child, published.static) == ("tool0", "wrist_optical", True)
    mm, deg = se3.deviation(X, published.T_parent_child)
    estimate = outcome.result.transform("gripper", "wrist")
    assert mm < 4 * 1e3 * np.sqrt(np.trace(estimate.covariance[3:, 3:]))
    assert (mm < 1.0, deg < 0.1) == (True, True)
    assert transport.closed
    assert transport.shown[0].shape == (360, 480, 3)
    again = read_result(tmp_path / "session" / "result.json")
    np.testing.assert_array_equal(again.transform("gripper", "wrist").matrix, estimate.matrix)
    assert sorted(p.name for p in (tmp_path / "session").iterdir()) == [
        "camera_info.json", "images", "poses.csv", "result.json",
    ]  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize(("above", "name"), [("wrist_link", "wrist_link"), ("tool0", "wrist_optical_calibrated")])
def test_the_frame_that_tf_knows_is_placed_by_its_top(tmp_path: Path, above: str, name: str) -> None:
    A, seen = stands(8)
    body = se3.make(so3.exp([-np.pi / 2, 0, 0]), [0.01, 0.02, 0.03])
    batches = driven(A, [{"/wrist/image": photo(T, i)} for i, T in enumerate(seen)])
    first = [Transform(above, "wrist_optical", body, 0.0, True)]
    transport = Played(iter([first, *batches]))
    serve(config(tmp_path), transport)
    (published,) = transport.static
    assert published.child == name
    T = published.T_parent_child @ body if name == "wrist_link" else published.T_parent_child
    assert se3.deviation(X, T)[0] < 1.0


@pytest.mark.long
def test_a_refusal_asks_for_more_samples(tmp_path: Path) -> None:
    """Stands that differ by shifts alone determine no place; turned ones that follow do."""
    A, seen = stands(11)
    T = np.array([seen[0] @ se3.make(np.eye(3), [0.02 * i, 0, 0]) for i in (-1, 0, 1)])
    poses = np.concatenate([gripper_poses("eye-in-hand", X, Z, T), A[3:]])
    pictures = [{"/wrist/image": photo(B, i)} for i, B in enumerate([*T, *seen[3:]])]
    transport, heard = Played(driven(poses, pictures)), Heard()
    outcome = serve(config(tmp_path, views=3), transport, heard)
    assert any("3 samples more are taken: go to other poses" in n for n in heard.notes)
    assert outcome.result is not None
    assert len(transport.static) == 1


def test_no_pose_names_the_frames_that_there_are(tmp_path: Path) -> None:
    grey = np.full((360, 480), 128, np.uint8)
    pictures = [message("/wrist/image", grey, 100.0 + 0.1 * i) for i in range(8)]
    heard = Heard()
    serve(config(tmp_path), Played(iter([[Transform("world", "arm", np.eye(4), 100.0, True)], pictures])), heard)
    assert heard.notes == ["no pose of tool0 in base at the pictures' time; frames in tf: arm in world"]


def test_a_damaged_picture_is_passed_over(tmp_path: Path) -> None:
    bad = Picture("/wrist/image", 100.5, "wrist_optical", 480, 360, "mono8", 480, np.zeros(9, np.uint8))
    stand = [Transform("base", "tool0", np.eye(4), 100 + i * RATE_S, False) for i in range(21)]
    good = message("/wrist/image", np.full((360, 480), 128, np.uint8), 100.9)
    heard = Heard()
    serve(config(tmp_path), Played(iter([stand, [bad], [good]])), heard)
    assert [n.split(";")[0] for n in heard.notes] == [
        "/wrist/image: 9 bytes in rows of 480 are no 480x360 px of mono8", "no board",
    ]  # fmt: skip


@pytest.mark.long
def test_a_camera_beside_the_robot_is_tracked_and_followed(tmp_path: Path) -> None:
    """Through the wrist camera's own result; moved in the middle, its old views are left out."""
    A, seen = stands(8)
    wrist = config(tmp_path)
    serve(wrist, Played(driven(A, [{"/wrist/image": photo(T, i)} for i, T in enumerate(seen)])))
    A, seen = stands(5, seed=11)
    moved = T_BASE_FRONT @ se3.make(so3.exp([0, 0, 0.05]), [0.03, 0, 0])
    places = [T_BASE_FRONT] * 3 + [moved] * 2
    pictures = [
        {"/wrist/image": photo(T, 20 + i), "/front/image": photo(se3.inverse(place) @ Z, 40 + i)}
        for i, (T, place) in enumerate(zip(seen, places))
    ]
    through = Through(image="/wrist/image", result=wrist.session / "result.json")
    front = config(
        tmp_path, name="front", image="/front/image", through=through, window=2, session=tmp_path / "front",
        frame="front_optical",
    )  # fmt: skip
    transport, heard = Played(driven(A, pictures)), Heard()
    serve(front, transport, heard)
    assert {(t.parent, t.child, t.static) for t in transport.live} == {("base", "front_optical_live", False)}
    assert any("contradicts the views before: the window starts anew" in n for n in heard.notes)
    assert len(transport.live) >= 5
    assert [t for t, _ in transport.poses] == transport.live
    for transform, covariance in transport.poses[:3]:
        error = se3.local(T_BASE_FRONT, transform.T_parent_child)
        assert error @ np.linalg.solve(covariance, error) < 16.8  # 1 in 100 of 6 degrees of freedom
    assert se3.deviation(T_BASE_FRONT, transport.live[2].T_parent_child)[0] < 3.0
    assert se3.deviation(moved, transport.live[-1].T_parent_child)[0] < 3.0
