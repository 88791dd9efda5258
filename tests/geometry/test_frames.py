from __future__ import annotations

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.geometry.frames import FrameGraph


def transforms(n: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return se3.make(so3.random(rng, n), rng.normal(size=(n, 3)))


def test_a_path_composes_and_inverts() -> None:
    T_base_gripper, T_gripper_camera, T_base_target = transforms(3)
    graph = (
        FrameGraph()
        .add("base", "gripper", T_base_gripper)
        .add("gripper", "camera", T_gripper_camera)
        .add("base", "target", T_base_target)
    )
    assert graph.frames == ("base", "gripper", "camera", "target")
    T_base_camera = T_base_gripper @ T_gripper_camera
    np.testing.assert_allclose(graph.T("base", "camera"), T_base_camera, atol=1e-14)
    np.testing.assert_allclose(graph.T("camera", "base"), np.linalg.inv(T_base_camera), atol=1e-14)
    np.testing.assert_allclose(graph.T("camera", "target"), np.linalg.inv(T_base_camera) @ T_base_target, atol=1e-14)
    np.testing.assert_array_equal(graph.T("base", "base"), np.eye(4))
    assert graph.path("camera", "target") == ("camera", "gripper", "base", "target")


def test_the_shortest_path_is_taken() -> None:
    T_a_b, T_b_c, T_c_d = transforms(3)
    long_way = FrameGraph().add("a", "b", T_a_b).add("b", "c", T_b_c).add("c", "d", T_c_d)
    both = long_way.add("a", "d", long_way.T("a", "d"))
    assert long_way.path("a", "d") == ("a", "b", "c", "d")
    assert both.path("a", "d") == ("a", "d")


def test_adding_leaves_the_old_graph_alone() -> None:
    T_a_b, T_b_c = transforms(2)
    small = FrameGraph().add("a", "b", T_a_b)
    small.add("b", "c", T_b_c)
    assert small.frames == ("a", "b")
    with pytest.raises(TypeError):
        small.transforms["a", "c"] = T_b_c  # type: ignore[index]
    with pytest.raises(ValueError, match="read-only"):
        small.transforms["a", "b"][0, 3] = 1.0
    before = small.T("a", "b")
    T_a_b[0, 3] += 1.0
    np.testing.assert_array_equal(small.T("a", "b"), before)


def test_moving_frames_carry_their_moments() -> None:
    T_base_gripper, T_gripper_camera = transforms(5), transforms(1, seed=1)[0]
    graph = FrameGraph().add("base", "gripper", T_base_gripper).add("gripper", "camera", T_gripper_camera)
    np.testing.assert_allclose(graph.T("base", "camera"), T_base_gripper @ T_gripper_camera, atol=1e-14)
    with pytest.raises(InputError, match=r"holds \(4,\) transforms, but the graph holds \(5,\)"):
        graph.add("camera", "target", transforms(4))


def test_unknown_frames_are_named_with_the_known_ones() -> None:
    graph = FrameGraph().add("base", "gripper", transforms(1)[0])
    with pytest.raises(InputError, match="unknown frame 'tool'; known frames: base, gripper"):
        graph.T("base", "tool")
    with pytest.raises(InputError, match="known frames: none"):
        FrameGraph().T("a", "b")


def test_disconnected_frames_are_told_in_groups() -> None:
    T = transforms(3)
    graph = FrameGraph().add("base", "gripper", T[0]).add("camera", "target", T[1]).add("gripper", "tool", T[2])
    assert graph.groups() == (("base", "gripper", "tool"), ("camera", "target"))
    with pytest.raises(InputError, match=r"'base' to 'target'.*\{base, gripper, tool\}; \{camera, target\}"):
        graph.T("base", "target")


@pytest.mark.parametrize("reverse", [False, True], ids=["same-direction", "inverted"])
def test_a_second_transform_must_agree(reverse: bool) -> None:
    T_a_b = transforms(1)[0]
    graph = FrameGraph().add("a", "b", T_a_b)
    ends = ("b", "a") if reverse else ("a", "b")
    agreeing = se3.inverse(T_a_b) if reverse else T_a_b
    assert graph.add(*ends, agreeing) is graph
    with pytest.raises(InputError, match=r"contradicts the known path .* differ by 2 mm and"):
        graph.add(*ends, se3.retract(agreeing, [0, 0, 0, 0.002, 0, 0]))
    with pytest.raises(InputError, match=r"differ by .* mm and 1 deg"):
        graph.add(*ends, se3.retract(agreeing, [0, np.deg2rad(1), 0, 0, 0, 0]))


def test_a_cycle_must_close_within_the_tolerance() -> None:
    T_a_b, T_b_c = transforms(2)
    T_a_c = se3.retract(T_a_b @ T_b_c, [0, 0, 0, 0.0005, 0, 0])
    with pytest.raises(InputError, match=r"T_a_c contradicts the known path a -> b -> c: they differ by 0.5 mm"):
        FrameGraph().add("a", "b", T_a_b).add("b", "c", T_b_c).add("a", "c", T_a_c)
    loose = FrameGraph(tolerance_m=0.001).add("a", "b", T_a_b).add("b", "c", T_b_c).add("a", "c", T_a_c)
    np.testing.assert_allclose(loose.T("a", "c"), T_a_c, atol=1e-15)


def test_what_is_no_transform_is_refused() -> None:
    with pytest.raises(InputError, match="T_base_camera"):
        FrameGraph().add("base", "camera", 2 * np.eye(4))
    with pytest.raises(InputError, match="both ends are called 'base'"):
        FrameGraph().add("base", "base", np.eye(4))
