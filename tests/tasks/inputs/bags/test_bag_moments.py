"""What commands take of a bag: topics, motion, still moments with a picture each; and bad input by name."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.made_bags import KINDS, BagWriter, written_bag

from calibrant.errors import InputError, MissingExtraError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.geometry.motion import Motion
from calibrant.robots.arms import arm
from calibrant.tasks.inputs.bags.poses import PosedPictures, posed_pictures
from calibrant.tasks.inputs.bags.sharpest import only_camera, taken_together
from calibrant.tasks.inputs.bags.topics import recorded_pictures
from calibrant.tasks.options.bags import BagOptions, PosedBagOptions
from calibrant.tasks.options.robots import RobotOptions

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")
POSES = [se3.make(so3.exp([0.1 * k, -0.05 * k, 0.2]), [0.4, 0.05 * k, 0.3]) for k in range(5)]
HOLD, MOVE = 1.0, 0.8
RNG = np.random.default_rng(5)
SCENES = RNG.integers(0, 256, (5, 24, 32), np.uint8)


def path() -> Motion:
    times = np.concatenate([[k * (HOLD + MOVE), k * (HOLD + MOVE) + HOLD] for k in range(len(POSES))])
    return Motion(times, np.repeat(np.stack(POSES), 2, axis=0))


def cell(
    folder: Path, kind: str = "mcap", *, offset: float = 0.0, hz: float = 50.0, during: Callable[[int], bool] = bool
) -> Path:
    """A robot that stops at five poses; 10 pictures a second, of one scene at each pose and of noise between. during:
    poses at which the picture goes on changing."""
    motion = path()
    events = [(float(t), "tf") for t in np.arange(0.0, motion.times[-1], 1 / hz)]
    events += [(float(t), "image") for t in np.arange(0.05, motion.times[-1], 0.1)]
    with written_bag(folder, kind) as (bag, writer):
        for t, what in sorted(events):
            if what == "tf":
                writer.transforms("/tf", {("base_link", "tool0"): motion.at([t])[0]}, t)
                continue
            k, within = divmod(t, HOLD + MOVE)
            still = within < HOLD and not (during is not bool and during(int(k)))
            picture = SCENES[int(k)] if still else RNG.integers(0, 256, (24, 32), np.uint8)
            noisy = np.clip(picture + RNG.normal(0, 2, picture.shape), 0, 255).astype(np.uint8)
            writer.image("/camera/image_raw", noisy, t, "mono8", stamp=t - offset)
    return bag


def posed(bag: Path, **options: object) -> PosedPictures:
    return posed_pictures(PosedBagOptions(bag=bag, tf="base_link:tool0", **options), RobotOptions())  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("offset", [0.0, 0.037, -0.037])
def test_one_picture_of_every_still_moment_with_its_pose(kind: str, offset: float, tmp_path: Path) -> None:
    found = posed(cell(tmp_path, kind, offset=offset))
    raw = found.raw()
    assert raw.names is not None
    assert len(raw) == 5
    np.testing.assert_allclose(raw.rotation, [T[:3, :3] for T in POSES], atol=1e-9)
    np.testing.assert_allclose(raw.translation, [T[:3, 3] for T in POSES], atol=1e-9)
    assert "5 still moments" in found.words
    (recorded,) = found.pictures.values()
    assert tuple(f.name for f in recorded.files) == raw.names
    within = np.array([0.05 + 0.1 * int(n) for n in raw.names]) % (HOLD + MOVE)
    assert np.all((within > 0.3) & (within < 0.7))


def test_joint_values_with_the_robot_are_its_poses(tmp_path: Path) -> None:
    chain = arm("ur5e")
    names = [joint.name for joint in chain.joints]
    q = np.array([[0.3, -1.2, 1.0, -0.5, 1.4, 0.2]]) + 0.2 * np.arange(5)[:, None]
    with written_bag(tmp_path, "sqlite3") as (bag, writer):
        for k in range(450):
            t = 0.02 * k
            i, within = divmod(t, HOLD + MOVE)
            share = max(0.0, (within - HOLD) / MOVE)
            values = q[int(i)] + share * (0.2 if i < 4 else 0.0)
            writer.joints("/joint_states", dict(zip(names, values)), t)
            if k % 10 == 5:
                writer.image("/camera/image_raw", SCENES[int(i)], t + 0.003, "mono8")
    options = PosedBagOptions(bag=bag)
    raw = posed_pictures(options, RobotOptions(robot="ur5e")).raw()
    assert raw.joints is not None
    np.testing.assert_allclose(raw.joints, q, atol=1e-6)
    np.testing.assert_allclose(raw.translation, chain.forward(q)[:, :3, 3], atol=1e-6)


def test_a_picture_that_goes_on_changing_is_left_out(tmp_path: Path) -> None:
    assert len(posed(cell(tmp_path, during=lambda k: k == 2)).raw()) == 4


def test_a_pose_with_every_picture_is_paired_by_the_nearest_time(tmp_path: Path) -> None:
    with written_bag(tmp_path, "ros1") as (bag, writer):
        for k, T in enumerate(POSES):
            writer.transforms("/tf", {("base_link", "tool0"): T}, 2.0 * k)
            writer.image("/camera/image_raw", SCENES[k], 2.0 * k, "mono8", stamp=2.0 * k - 0.037)
    found = posed(bag)
    np.testing.assert_allclose(found.raw().translation, [T[:3, 3] for T in POSES], atol=1e-12)
    assert "5 pictures, each with the pose nearest in time" in found.words


def test_on_the_move_poses_are_those_at_the_pictures_times(tmp_path: Path) -> None:
    def pose(t: float) -> np.ndarray:
        return se3.make(so3.exp([0.3 * np.sin(t), 0.2 * np.cos(t), 0.0]), [0.1 * np.sin(2 * t), 0.0, 0.1 * np.cos(t)])

    with written_bag(tmp_path, "mcap") as (bag, writer):
        for k in range(300):
            t = 0.02 * k
            writer.transforms("/tf", {("base_link", "tool0"): pose(t)}, t)
            if k % 10 == 5:
                writer.image("/camera/image_raw", SCENES[0], t + 0.007, "mono8", stamp=t + 0.007 - 0.037)
    found = posed(bag, moments="moving", clock_offset="37ms")
    T = [pose(0.2 * k + 0.1 + 0.007) for k in range(len(found.raw()))]
    np.testing.assert_allclose(found.raw().translation, [t[:3, 3] for t in T], atol=1e-6)
    np.testing.assert_allclose(found.raw().rotation, [t[:3, :3] for t in T], atol=1e-6)
    with pytest.raises(RefusedError, match=r"no 3 still moments: 0 in 6.0 s.*--moments moving"):
        posed(bag)


def two_cameras(writer: BagWriter, late_s: float = 0.004) -> None:
    for k in range(6):
        writer.image("/left/image_raw", SCENES[0] + np.uint8(k), 0.1 * k, "mono8")
        if k != 3:  # a frame that was lost
            writer.compressed("/right/image_raw/compressed", SCENES[1], 0.1 * k + late_s)


def test_pictures_of_two_cameras_meet_in_time_though_one_was_lost(tmp_path: Path) -> None:
    with written_bag(tmp_path, "mcap") as (bag, writer):
        two_cameras(writer)
    topics = ("right=/right/image_raw", "left=/left/image_raw")  # its compressed pictures are meant
    found = taken_together(BagOptions(bag=bag, image_topic=topics), names=("left", "right"))
    assert list(found.files) == ["left", "right"]
    assert [len(f) for f in found.files.values()] == [6, 5]
    seconds = {c: [t for _, t in sorted(times.items())] for c, times in found.times.seconds.items()}
    np.testing.assert_allclose(seconds["left"], 0.1 * np.arange(6), atol=1e-6)
    np.testing.assert_allclose(seconds["right"], 0.1 * np.array([0, 1, 2, 4, 5]) + 0.004, atol=1e-6)


def test_of_several_cameras_each_is_asked_for(tmp_path: Path) -> None:
    with written_bag(tmp_path, "ros1") as (bag, writer):
        two_cameras(writer)
    listed = r"/left/image_raw \(6 pictures\), /right/image_raw/compressed \(5 pictures\)"
    with pytest.raises(InputError, match=rf"several cameras: {listed}; say which: --image-topic /left/image_raw"):
        recorded_pictures(BagOptions(bag=bag))
    with pytest.raises(InputError, match=rf"no pictures under /top; it has {listed}"):
        recorded_pictures(BagOptions(bag=bag, image_topic=("/top",)))
    with pytest.raises(InputError, match="give one --image-topic"):
        only_camera(BagOptions(bag=bag, image_topic=("a=/left/image_raw", "b=/right/image_raw")), ())
    with pytest.raises(InputError, match=r"--image-topic left=TOPIC and --image-topic right=TOPIC; found a, b"):
        taken_together(
            BagOptions(bag=bag, image_topic=("a=/left/image_raw", "b=/right/image_raw")), names=("left", "right")
        )
    with pytest.raises(InputError, match="given twice"):
        recorded_pictures(BagOptions(bag=bag, image_topic=("a=/left/image_raw", "b=/left/image_raw")))


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_without_what_is_needed_says_what_it_has(kind: str, tmp_path: Path) -> None:
    with written_bag(tmp_path, kind) as (bag, writer):
        writer.joints("/joint_states", {"a": 0.0}, 0.0)
    with pytest.raises(InputError, match=r"no pictures .*it has /joint_states \(sensor_msgs/msg/JointState\)"):
        recorded_pictures(BagOptions(bag=bag))
    other = tmp_path / "other"
    other.mkdir()
    with written_bag(other, kind) as (bag, writer):
        writer.joints("/joint_states", {"a": 0.0}, 0.0)
        writer.image("/image", SCENES[0], 0.0, "mono8")
    with pytest.raises(InputError, match="It has no tf, and joint values: give the robot, --robot FILE"):
        posed_pictures(PosedBagOptions(bag=bag), RobotOptions())


def test_pictures_of_another_time_than_the_poses_are_refused(tmp_path: Path) -> None:
    bag = cell(tmp_path, offset=500.0)
    with pytest.raises(InputError, match=r"no picture of /camera/image_raw was taken while.*--stamps received"):
        posed(bag)
    assert len(posed(bag, stamps="received").raw()) == 5


def test_the_frames_are_proposed_where_they_are_not_told(tmp_path: Path) -> None:
    bag = cell(tmp_path, hz=10.0)
    with pytest.raises(InputError, match=r"perhaps --tf base_link:tool0; its frames are\n  base_link\n    tool0 \*"):
        posed_pictures(PosedBagOptions(bag=bag), RobotOptions())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tf": "base"}, "--tf takes two frames"),
        ({"clock_offset": "37"}, "--clock-offset takes a time with its unit"),
        ({"moments": "all"}, "--moments all: choose still or moving"),
        ({"stamps": "mine"}, "--stamps mine: choose header or received"),
        ({"tf": "a:b", "joint_topic": "/j"}, "give one of them"),
    ],
)
def test_options_that_say_nothing_are_refused(options: dict[str, str], message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        posed_pictures(PosedBagOptions(bag=tmp_path / "run.bag", **options), RobotOptions())  # type: ignore[arg-type]


def test_a_bag_that_is_not_there_or_no_bag_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"run.bag does not exist"):
        posed(tmp_path / "run.bag")
    with pytest.raises(InputError, match=r"the folder has no metadata.yaml"):
        posed(tmp_path)
    (tmp_path / "run.csv").write_text("1,2")
    with pytest.raises(InputError, match=r"expected a file .bag, .mcap, .db3"):
        posed(tmp_path / "run.csv")


@pytest.mark.parametrize("options", [{"image_topic": ("/a",)}, {"tf": "a:b"}, {"moments": "moving"}])
def test_what_is_in_a_bag_needs_the_bag(options: dict[str, object]) -> None:
    with pytest.raises(InputError, match=r"give it \(--bag FILE\)"):
        PosedBagOptions(**options).check()  # type: ignore[arg-type]


def test_without_the_extra_its_install_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "run.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(50))
    for module in [m for m in sys.modules if m.split(".")[0] == "rosbags"]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(MissingExtraError, match=r'pip install "calibrant\[ros\]"'):
        recorded_pictures(BagOptions(bag=tmp_path / "run.mcap"))
