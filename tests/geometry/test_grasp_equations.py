"""The documents' grasp equations against a scene in which every frame's place in the world is known."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.geometry import grasp_equations, se3, so3

FRAMES = ("world", "base", "flange", "gripper", "object", "camera")


@pytest.fixture
def scene() -> dict[str, np.ndarray]:
    """T_world_<frame>; the gripper holds the object, so the grasp frame is the gripper frame."""
    rng = np.random.default_rng(12)
    places = {name: se3.make(so3.random(rng, 1)[0], rng.normal(size=3)) for name in FRAMES}
    places["world"] = np.eye(4)
    places["grasp"] = places["gripper"]
    return places


def T(scene: dict[str, np.ndarray], a: str, b: str) -> np.ndarray:
    return np.linalg.inv(scene[a]) @ scene[b]


def test_T6_and_B_of_the_grasp(scene: dict[str, np.ndarray]) -> None:
    T6 = grasp_equations.solve_T6(
        T_world_base=T(scene, "world", "base"),
        T_world_object=T(scene, "world", "object"),
        T_object_grasp=T(scene, "object", "grasp"),
        T_flange_gripper=T(scene, "flange", "gripper"),
    )
    np.testing.assert_allclose(T6, T(scene, "base", "flange"), atol=1e-13)
    B = grasp_equations.solve_B(
        T_world_base=T(scene, "world", "base"),
        T_base_flange=T6,
        T_flange_gripper=T(scene, "flange", "gripper"),
        T_object_grasp=T(scene, "object", "grasp"),
    )
    np.testing.assert_allclose(B, T(scene, "world", "object"), atol=1e-13)


def test_T6_in_numbers() -> None:
    """A table-top job one can do in the head: all axes parallel, so the origins add up."""

    def shift(x: float, y: float, z: float) -> np.ndarray:
        return se3.make(np.eye(3), [x, y, z])

    T6 = grasp_equations.solve_T6(
        T_world_base=shift(1, 0, 0),
        T_world_object=shift(1, 2, 0),
        T_object_grasp=shift(0, 0, 0.1),
        T_flange_gripper=shift(0, 0, 0.2),
    )
    np.testing.assert_allclose(T6[:3, 3], [0, 2, -0.1], atol=1e-15)


def test_P_and_C_of_the_camera(scene: dict[str, np.ndarray]) -> None:
    T_grasp_camera, T_camera_world = T(scene, "grasp", "camera"), T(scene, "camera", "world")
    P = grasp_equations.solve_P(T_grasp_camera=T_grasp_camera, T_camera_world=T_camera_world)
    np.testing.assert_allclose(P, T(scene, "grasp", "world"), atol=1e-13)
    # Read as maps of coordinates the same statement is P = C I.
    coordinates = T(scene, "world", "camera") @ T(scene, "camera", "grasp")
    np.testing.assert_allclose(se3.inverse(P), coordinates, atol=1e-13)
    C = grasp_equations.solve_C(T_grasp_camera=T_grasp_camera, T_grasp_world=P)
    np.testing.assert_allclose(C, T_camera_world, atol=1e-13)


def test_eye_to_hand_loop() -> None:
    rng = np.random.default_rng(13)
    T_base_gripper = se3.make(so3.random(rng, 6), rng.normal(size=(6, 3)))
    T_base_camera, T_gripper_target = se3.make(so3.random(rng, 2), rng.normal(size=(2, 3)))
    T_target_camera = np.linalg.inv(T_base_gripper @ T_gripper_target) @ T_base_camera
    D = grasp_equations.solve_D(
        T_base_gripper=T_base_gripper, T_gripper_target=T_gripper_target, T_target_camera=T_target_camera
    )
    np.testing.assert_allclose(D, np.broadcast_to(T_base_camera, D.shape), atol=1e-13)
    M, N = grasp_equations.eye_to_hand_motions(T_base_gripper=T_base_gripper, T_target_camera=T_target_camera)
    assert M.shape == N.shape == (5, 4, 4)
    np.testing.assert_allclose(M @ T_gripper_target, T_gripper_target @ N, atol=1e-13)
    np.testing.assert_allclose(M[0], np.linalg.inv(T_base_gripper[1]) @ T_base_gripper[0], atol=1e-13)


def test_eye_in_hand_loop() -> None:
    rng = np.random.default_rng(14)
    T_base_gripper = se3.make(so3.random(rng, 6), rng.normal(size=(6, 3)))
    T_gripper_camera, T_base_target = se3.make(so3.random(rng, 2), rng.normal(size=(2, 3)))
    T_target_camera = np.linalg.inv(T_base_target) @ T_base_gripper @ T_gripper_camera
    M, N = grasp_equations.eye_in_hand_motions(T_base_gripper=T_base_gripper, T_target_camera=T_target_camera)
    np.testing.assert_allclose(M @ T_gripper_camera, T_gripper_camera @ N, atol=1e-13)


def test_loops_refuse_what_cannot_be_paired() -> None:
    poses = np.broadcast_to(np.eye(4), (3, 4, 4))
    with pytest.raises(InputError, match=r"got \(3, 4, 4\) and \(2, 4, 4\)"):
        grasp_equations.eye_in_hand_motions(T_base_gripper=poses, T_target_camera=poses[:2])
    with pytest.raises(InputError, match="n >= 2"):
        grasp_equations.eye_to_hand_motions(T_base_gripper=poses[:1], T_target_camera=poses[:1])


def test_chains_name_the_matrix_that_is_wrong() -> None:
    with pytest.raises(InputError, match="T_object_grasp"):
        grasp_equations.solve_T6(
            T_world_base=np.eye(4),
            T_world_object=np.eye(4),
            T_object_grasp=np.zeros((4, 4)),
            T_flange_gripper=np.eye(4),
        )
