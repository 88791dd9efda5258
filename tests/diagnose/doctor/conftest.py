"""Cases of the doctor from simulated scenes, from pose pairs and from views."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant.data import RobotPoses
from calibrant.diagnose.doctor import Case, case_of_poses, case_of_views
from calibrant.simulate.scenes import HandEyeScene, hand_eye_scene

Array = NDArray[np.float64]
CaseOf = Callable[..., Case]


def _names(n: int) -> tuple[str, ...]:
    return tuple(f"{i}.png" for i in range(n))


@pytest.fixture(scope="session")
def pairs() -> CaseOf:
    """A case of measured target poses; T and B replace those of the scene."""

    def make(scene: HandEyeScene | None = None, *, T: Array | None = None, B: Array | None = None) -> Case:
        scene = scene or hand_eye_scene("good", views=15)
        T = scene.robot_poses.T_base_gripper if T is None else T
        B = scene.measured_T_camera_target if B is None else B
        return case_of_poses(RobotPoses(_names(len(T)), T), B, setup=scene.setup)

    return make


@pytest.fixture(scope="session")
def views() -> CaseOf:
    """A case of views seen by the scene's camera, or another one."""

    def make(scene: HandEyeScene | None = None, *, T: Array | None = None, camera: object | None = None) -> Case:
        scene = scene or hand_eye_scene("good", views=15)
        names = _names(len(scene.observations.views))
        seen = tuple(replace(v, id=i, moment=i) for v, i in zip(scene.observations.views, names))
        poses = RobotPoses(names, scene.robot_poses.T_base_gripper if T is None else T)
        observations = replace(scene.observations, views=seen)
        return case_of_views(
            poses,
            observations,
            camera or scene.camera,
            setup=scene.setup,
            camera_given=camera is not None,  # type: ignore[arg-type]
        )

    return make
