"""The tree of frames of a bag: chains composed at their times, and what is said where there is no chain."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.made_bags import EPOCH_NS, KINDS, written_bag

from calibrant.errors import InputError
from calibrant.formats.bags.bag import opened
from calibrant.formats.bags.joints import read_joints
from calibrant.formats.bags.stamps import seconds_of
from calibrant.formats.bags.transforms import Tree, read_tree
from calibrant.geometry import se3, so3
from calibrant.robots.arms import arm

OUT = se3.make(so3.exp([0.1, 0.2, 0.3]), [0.1, 0.0, 0.4])
SIDE = se3.make(so3.exp([0.5, 0.0, -0.1]), [0.0, 0.3, 0.2])


def turned(t: float) -> np.ndarray:
    return se3.make(so3.exp([0.0, 0.0, 0.4 * t]), [0.2, 0.1 * t, 0.0])


def tree(folder: Path, kind: str = "mcap") -> Tree:
    with written_bag(folder, kind) as (path, writer):
        writer.transforms("/tf_static", {("world", "base_link"): SIDE, ("wrist", "tool0"): OUT}, 0.0)
        writer.transforms("/tf_static", {("cart", "lamp"): OUT}, 0.1)
        for t in np.arange(0.0, 2.0, 0.1):
            writer.transforms("/tf", {("/base_link", "wrist"): turned(t)}, 0.2 + t)
    with opened(path) as bag:
        return read_tree(bag)


@pytest.mark.parametrize("kind", KINDS)
def test_a_chain_of_standing_and_moving_frames_is_composed(kind: str, tmp_path: Path) -> None:
    found = tree(tmp_path, kind)
    motion = found.motion("world", "tool0")
    t = motion.times - EPOCH_NS * 1e-9 - 0.2
    np.testing.assert_allclose(t, np.arange(0.0, 2.0, 0.1), atol=1e-6)
    np.testing.assert_allclose(motion.T, [SIDE @ turned(s) @ OUT for s in t], atol=1e-6)
    back = found.motion("tool0", "world")  # up the tree
    np.testing.assert_allclose(back.T, se3.inverse(motion.T), atol=1e-9)
    assert found.proposal() == "base_link:tool0"


def test_frames_that_are_not_there_or_not_connected_show_the_tree(tmp_path: Path) -> None:
    found = tree(tmp_path)
    shown = r"world\n    base_link\n      wrist \*\n        tool0"
    with pytest.raises(InputError, match=rf"no frame 'tool1'; its frames are\n  cart\n    lamp\n  {shown}"):
        found.motion("base_link", "tool1")
    with pytest.raises(InputError, match=rf"base_link and lamp are not connected(.|\n)*{shown}"):
        found.motion("base_link", "lamp")
    with pytest.raises(InputError, match="nothing moves between world and base_link"):
        found.motion("world", "base_link")


def test_a_quaternion_that_is_none_is_named(tmp_path: Path) -> None:
    with written_bag(tmp_path, "ros1") as (path, writer):
        writer.transforms("/tf", {("a", "b"): turned(0.0)}, 0.0)
        message = writer.type("tf2_msgs/msg/TFMessage")
        kinds = {n: writer.type(f"geometry_msgs/msg/{n}") for n in ("Vector3", "Quaternion", "Transform")}
        zero = kinds["Transform"](translation=kinds["Vector3"](0, 0, 0), rotation=kinds["Quaternion"](0, 0, 0, 0))
        stamped = writer.type("geometry_msgs/msg/TransformStamped")
        one = stamped(header=writer.header(0.1, "a"), child_frame_id="b", transform=zero)
        writer.write("/tf", message(transforms=[one]), 0.1)
    with opened(path) as bag, pytest.raises(InputError, match=r"transform 1 of frame b is no pose.* norm 0"):
        read_tree(bag)


def test_joint_values_are_those_of_the_chain_by_name(tmp_path: Path) -> None:
    chain = arm("ur5e")
    names = [joint.name for joint in chain.joints]
    with written_bag(tmp_path, "sqlite3") as (path, writer):
        for k in range(4):
            values = {name: 0.1 * k + i for i, name in enumerate(names)}
            writer.joints("/joint_states", dict(reversed(values.items())), 0.1 * k)
            writer.joints("/joint_states", {"finger": 0.02}, 0.1 * k + 0.05)
    with opened(path) as bag:
        found = read_joints(bag, chain)
        np.testing.assert_allclose(found.q[2], 0.2 + np.arange(len(names)))
        np.testing.assert_allclose(found.at(found.times[:1] + 0.05), [0.05 + np.arange(len(names))], atol=1e-6)
        with pytest.raises(InputError, match=r"no joint values under /other; topics that have some: /joint_states"):
            read_joints(bag, chain, "/other")


STEADY = [EPOCH_NS + k * 10**8 for k in range(40)]


@pytest.mark.parametrize("jump_s", [-30.0, -0.3, 0.3, 3600.0])
def test_a_clock_that_is_set_is_refused_with_when(jump_s: float) -> None:
    stamps = [s + (int(jump_s * 1e9) if k >= 17 else 0) for k, s in enumerate(STEADY)]
    word = "forward" if jump_s > 0 else "back"
    with pytest.raises(InputError, match=rf"clock of x jumps {word} by {abs(jump_s):.3f} s, 1.7 s after"):
        seconds_of(stamps, STEADY, what="x")
    np.testing.assert_allclose(seconds_of(stamps, STEADY, what="x", stamps="received"), np.array(STEADY) * 1e-9)


def test_a_recorder_that_was_held_up_is_no_jump() -> None:
    received = [r + (2 * 10**9 if 10 <= k < 13 else 0) for k, r in enumerate(STEADY)]
    np.testing.assert_allclose(seconds_of(STEADY, received, what="x"), np.array(STEADY) * 1e-9)
    slow = [EPOCH_NS + k * 10**7 for k in range(40)]  # a simulated clock at a tenth of the speed
    seconds_of(slow, STEADY, what="x")


def test_headers_without_times_are_the_recorders(tmp_path: Path) -> None:
    np.testing.assert_allclose(seconds_of([0] * 40, STEADY, what="x"), np.array(STEADY) * 1e-9)


def test_two_parents_matter_on_the_way_alone(tmp_path: Path) -> None:
    with written_bag(tmp_path, "mcap") as (path, writer):
        for k in range(3):
            writer.transforms("/tf", {("a", "b"): turned(0.1 * k), ("a", "part"): OUT}, 0.1 * k)
            writer.transforms("/tf", {("b", "part"): OUT}, 0.1 * k + 0.05)
    with opened(path) as bag:
        found = read_tree(bag)
    assert len(found.motion("a", "b").times) == 3
    with pytest.raises(InputError, match="part has two parents, a and b, in turn"):
        found.motion("a", "part")


def test_a_circle_of_frames_is_refused(tmp_path: Path) -> None:
    with written_bag(tmp_path, "ros1") as (path, writer):
        writer.transforms("/tf", {("a", "b"): OUT, ("b", "a"): OUT}, 0.0)
    with opened(path) as bag, pytest.raises(InputError, match="go in a circle"):
        read_tree(bag).motion("a", "b")
