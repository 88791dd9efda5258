"""The kinematic chains of lecture 000/001 (slides 413-420) and the camera loops of document 002, in frames.

Lecture. It says "Z: transformation from world coordinates to manipulator base coordinates" and draws Z: World -> Base.
As a map of coordinates the words would be T_base_world, but Z T6 E = B G composes as matrices acting on column vectors
only when an arrow a -> b is the pose of b in a (the lecture's own "R that describes rotations to generate frame K from
frame B"). That reading, "from a to b" = T_a_b, is taken for every letter, and under it each printed formula holds:

    Z = T_world_base    T6 = T_base_flange    E = T_flange_gripper    B = T_world_object    G = T_object_grasp
    grasping, the gripper frame lies in the grasp frame:  Z T6 E = B G

    I = T_grasp_camera ("of grasping point coordinates into the camera frame")    C = T_camera_world
    P = T_grasp_world = I C                                                       C = I^-1 P

Who reads I, C and P as maps of coordinates has their inverses, T_camera_grasp, T_world_camera and T_world_grasp, and
the product turns round: P = C I. It is the same statement. Every argument here is named with its frames; pass by name.

Document 002. {A} to {D} are poses "of x in y", so they are T_y_x without a second reading. It calls C "actually the
extrinsic parameter of the camera", but [R|t] of its own equation 9 takes plate coordinates to camera coordinates,
T_camera_target, while C, "the pose of the camera in the calibration plate frame", is the inverse, T_target_camera.

    eye-to-hand   A = T_base_gripper   B = T_gripper_target   C = T_target_camera   D = T_base_camera = A B C     (1)
                  (A2^-1 A1) B = B (C2 C1^-1)                                                                     (3)
    eye-in-hand   A = T_base_gripper   B = T_gripper_camera   C = T_target_camera   A1 B C1^-1 = A2 B C2^-1       (5)
                  (A2^-1 A1) B = B (C2^-1 C1)                                                                     (6)

All functions are batched over leading axes, metres.
"""

from __future__ import annotations

from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import se3


def solve_T6(
    *, T_world_base: ArrayLike, T_world_object: ArrayLike, T_object_grasp: ArrayLike, T_flange_gripper: ArrayLike
) -> Array:
    """Where the arm must go to grasp: T_base_flange, T6 = Z^-1 B G E^-1.

    Args: Z, B, G and E, each (..., 4, 4). Returns (..., 4, 4). Raises: InputError for what is no rigid transform.
    """
    Z, B = se3.check(T_world_base, name="T_world_base"), se3.check(T_world_object, name="T_world_object")
    G, E = se3.check(T_object_grasp, name="T_object_grasp"), se3.check(T_flange_gripper, name="T_flange_gripper")
    return se3.inverse(Z) @ B @ G @ se3.inverse(E)


def solve_B(
    *, T_world_base: ArrayLike, T_base_flange: ArrayLike, T_flange_gripper: ArrayLike, T_object_grasp: ArrayLike
) -> Array:
    """Where the grasped object is: T_world_object, B = Z T6 E G^-1.

    Args: Z, T6, E and G, each (..., 4, 4). Returns (..., 4, 4). Raises: InputError for what is no rigid transform.
    """
    Z, T6 = se3.check(T_world_base, name="T_world_base"), se3.check(T_base_flange, name="T_base_flange")
    E, G = se3.check(T_flange_gripper, name="T_flange_gripper"), se3.check(T_object_grasp, name="T_object_grasp")
    return Z @ T6 @ E @ se3.inverse(G)


def solve_P(*, T_grasp_camera: ArrayLike, T_camera_world: ArrayLike) -> Array:
    """The grasp point against the world through the camera: T_grasp_world, P = I C.

    The grasp's pose in the world, T_world_grasp, is its inverse. Args: I and C, each (..., 4, 4).
    """
    return se3.check(T_grasp_camera, name="T_grasp_camera") @ se3.check(T_camera_world, name="T_camera_world")


def solve_C(*, T_grasp_camera: ArrayLike, T_grasp_world: ArrayLike) -> Array:
    """The camera against the world from one grasp point seen both ways: T_camera_world, C = I^-1 P.

    The camera's pose in the world, T_world_camera, is its inverse. Args: I and P, each (..., 4, 4).
    """
    I_inverse = se3.inverse(se3.check(T_grasp_camera, name="T_grasp_camera"))
    return I_inverse @ se3.check(T_grasp_world, name="T_grasp_world")


def solve_D(*, T_base_gripper: ArrayLike, T_gripper_target: ArrayLike, T_target_camera: ArrayLike) -> Array:
    """The fixed camera in the robot's base: T_base_camera, D = A B C (002, equation 1, eye-to-hand).

    Args: A, B and C, each (..., 4, 4). Returns (..., 4, 4), one a pose; on exact data they are all the same.
    """
    A = se3.check(T_base_gripper, name="T_base_gripper")
    B = se3.check(T_gripper_target, name="T_gripper_target")
    return A @ B @ se3.check(T_target_camera, name="T_target_camera")


def eye_to_hand_motions(*, T_base_gripper: ArrayLike, T_target_camera: ArrayLike) -> tuple[Array, Array]:
    """Motions (M, N) of consecutive poses with M X = X N, X = T_gripper_target (002, equation 3).

    M = A2^-1 A1, N = C2 C1^-1. Args: A and C, each (n, 4, 4), n >= 2, paired. Returns two (n - 1, 4, 4).
    """
    A, C = _paired(T_base_gripper, T_target_camera)
    return se3.inverse(A[1:]) @ A[:-1], C[1:] @ se3.inverse(C[:-1])


def eye_in_hand_motions(*, T_base_gripper: ArrayLike, T_target_camera: ArrayLike) -> tuple[Array, Array]:
    """Motions (M, N) of consecutive poses with M X = X N, X = T_gripper_camera (002, equation 6).

    M = A2^-1 A1, N = C2^-1 C1. Args: A and C, each (n, 4, 4), n >= 2, paired. Returns two (n - 1, 4, 4).
    """
    A, C = _paired(T_base_gripper, T_target_camera)
    return se3.inverse(A[1:]) @ A[:-1], se3.inverse(C[1:]) @ C[:-1]


def _paired(T_base_gripper: ArrayLike, T_target_camera: ArrayLike) -> tuple[Array, Array]:
    A, C = se3.check(T_base_gripper, name="T_base_gripper"), se3.check(T_target_camera, name="T_target_camera")
    if A.ndim != 3 or A.shape != C.shape or len(A) < 2:
        raise InputError(
            f"a loop needs the same number of robot poses and target poses, (n, 4, 4) with n >= 2; "
            f"got {A.shape} and {C.shape}"
        )
    return A, C
