# Written by calibrant.tasks.signatures from the Requests; a test says when it is old.
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from calibrant.data import CalibrationResult
from calibrant.tasks.registry import Entry, Task

Words = str | Path | Iterable[str | Path] | Mapping[str, str | Path | Iterable[str | Path]]
"""One value, several of them, or several by the name of a camera or robot."""

VERBS: dict[str, str]

def verb(name: str) -> Callable[..., CalibrationResult | None]: ...
def signature_of(task: Task) -> Any: ...
def documentation(name: str, entry: Entry, task: Task) -> str: ...
def target(
    spec: str,
    *,
    out: str | Path,
    page: str = "auto",
    force: bool = False,
) -> CalibrationResult: ...
def detect(
    images: Words = (),
    *,
    target: str | None = None,
    mirror_x: bool = False,
    exclude: Words = (),
    workers: str | None = None,
    cache: str | None = None,
    refine: str = "saddle",
    window: str | None = None,
    zero_zone: str | None = None,
    overlays: str | Path | None = None,
    force: bool = False,
) -> CalibrationResult: ...
def intrinsics(
    images: Words = (),
    *,
    target: str | None = None,
    observations: str | Path | None = None,
    model: str = "brown",
    fix: Words = (),
    initial: str | Path | None = None,
    max_error: str | None = None,
    target_shape: str = "flat",
    mirror_x: bool = False,
    exclude: Words = (),
    workers: str | None = None,
    cache: str | None = None,
    refine: str = "saddle",
    window: str | None = None,
    zero_zone: str | None = None,
    opencv_yaml: str | Path | None = None,
    force: bool = False,
) -> CalibrationResult: ...
def hand_eye(
    *,
    poses: Words,
    images: Words = (),
    target: Words = (),
    observations: str | Path | None = None,
    target_poses: Words = (),
    target_pose_rotation: str = "auto",
    camera: Words = (),
    setup: Words = (),
    pose_units: str = "auto",
    pose_rotation: str = "auto",
    pose_angle: str = "auto",
    pose_direction: str = "auto",
    robot_format: str | None = None,
    robot: str | None = None,
    robot_link: str | None = None,
    robot_base: str | None = None,
    joint_angle: str = "auto",
    identify: Words = (),
    method: str = "joint",
    workspace: str | None = None,
    tolerance: str | None = None,
    target_sigma: str | None = None,
    model: str = "brown",
    fix: Words = (),
    mirror_x: bool = False,
    exclude: Words = (),
    workers: str | None = None,
    cache: str | None = None,
    refine: str = "saddle",
    window: str | None = None,
    zero_zone: str | None = None,
) -> CalibrationResult: ...
def doctor(
    *,
    poses: Words,
    images: Words = (),
    target: str | None = None,
    observations: str | Path | None = None,
    target_poses: Words = (),
    target_pose_rotation: str = "auto",
    camera: str | Path | None = None,
    setup: str = "auto",
    pose_units: str = "auto",
    pose_rotation: str = "auto",
    pose_angle: str = "auto",
    pose_direction: str = "auto",
    robot_format: str | None = None,
    robot: str | None = None,
    robot_link: str | None = None,
    robot_base: str | None = None,
    joint_angle: str = "auto",
    apply: bool = False,
    repaired_poses: str | Path | None = None,
    model: str = "brown",
    fix: Words = (),
    mirror_x: bool = False,
    exclude: Words = (),
    workers: str | None = None,
    cache: str | None = None,
    force: bool = False,
) -> CalibrationResult: ...
def pose(
    images: Words = (),
    *,
    target: str | None = None,
    camera: str | Path | None = None,
    observations: str | Path | None = None,
    sigma_px: str | None = None,
    confidence: float = 0.99,
    mirror_x: bool = False,
    exclude: Words = (),
    workers: str | None = None,
    cache: str | None = None,
    overlay: str | Path | None = None,
    force: bool = False,
) -> CalibrationResult: ...
def vanishing(
    image: str | Path,
    *,
    camera: str | Path | None = None,
    focal: str = "known",
    overlay: str | Path | None = None,
    force: bool = False,
) -> CalibrationResult: ...
def report(
    result: str | Path,
    *,
    out: str | Path | None = None,
    workspace: str | None = None,
    tolerance: str | None = None,
    target_sigma: str | None = None,
    force: bool = False,
) -> CalibrationResult: ...
def time_offset(
    *,
    poses: str | Path,
    target_poses: str | Path,
    setup: str = "eye-in-hand",
    largest: str = "2s",
    robot_format: str | None = None,
    robot: str | None = None,
    robot_link: str | None = None,
    robot_base: str | None = None,
    joint_angle: str = "auto",
) -> CalibrationResult: ...
def tool_touch(
    *,
    poses: Words,
    robot_format: str | None = None,
    robot: str | None = None,
    robot_link: str | None = None,
    robot_base: str | None = None,
    joint_angle: str = "auto",
    pose_units: str = "auto",
    pose_rotation: str = "auto",
    pose_angle: str = "auto",
    pose_direction: str = "base-gripper",
) -> CalibrationResult: ...
def tool_seen(
    *,
    poses: Words,
    pixels: str | Path,
    result: str | Path,
    robot_format: str | None = None,
    robot: str | None = None,
    robot_link: str | None = None,
    robot_base: str | None = None,
    joint_angle: str = "auto",
    pose_units: str = "auto",
    pose_rotation: str = "auto",
    pose_angle: str = "auto",
    pose_direction: str = "auto",
) -> CalibrationResult: ...
def tool_self_visibility(
    *,
    image: str | Path,
    features: str | Path,
    camera: str | Path,
    target: str | None = None,
    sigma_px: str = "0.5px",
) -> CalibrationResult: ...
