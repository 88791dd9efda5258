"""Cancelling: every long phase stops within a second, raises CancelledError, and leaves nothing half done."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from tests.contracts.doors import TARGET, make_files
from tests.contracts.doors_robots import ROBOT_CASES

from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.cancel import Token, answered, cancellable, checkpoint
from calibrant.data import RobotPoses
from calibrant.detection.pipeline import detect
from calibrant.errors import CalibrantError, CancelledError
from calibrant.simulate.cell import poses_csv
from calibrant.simulate.scenes import hand_eye_scene, intrinsics_scene
from calibrant.tasks.cameras import intrinsics
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.fields import build
from calibrant.tasks.options.images import PhotoOptions, SearchOptions
from calibrant.tasks.options.poses import TargetPoseOptions
from calibrant.tasks.outcome import Document
from calibrant.tasks.registry import TASKS
from calibrant.tasks.robots import doctor
from calibrant.tasks.writing import write_documents

WITHIN = 1.0
"""Seconds from asking to the end, the promise."""


class CancelsAt(Listener):
    """Cancels as soon as a phase of that name has begun."""

    def __init__(self, token: Token, phase: str) -> None:
        self.token, self.phase, self.asked = token, phase, 0.0

    def _begun(self, text: str) -> None:
        if text.startswith(self.phase):
            self.asked = time.perf_counter()
            self.token.cancel()

    @contextmanager
    def status(self, text: str) -> Any:
        self._begun(text)
        yield

    @contextmanager
    def progress(self, title: str) -> Any:
        self._begun(title)
        yield lambda done, total, name: None


def repeat(work: Callable[[], object]) -> None:
    """For ever: work that is faster than the one who cancels it begins again."""
    while True:
        work()


def cancelled_after(seconds: float, work: Callable[[], object]) -> float:
    """How long the work took to stop once it was asked; it must raise CancelledError."""
    work()  # what a first run compiles is compiled
    token, asked = Token(), []

    def ask() -> None:
        asked.append(time.perf_counter())
        token.cancel()

    timer = threading.Timer(seconds, ask)
    timer.start()
    try:
        with cancellable(token), pytest.raises(CancelledError):
            repeat(work)
    finally:
        timer.cancel()
    return time.perf_counter() - asked[0]


def test_a_task_that_ends_by_being_stopped_goes_on_with_what_it_has() -> None:
    token = Token()
    with cancellable(token):
        token.cancel()
        answered()
        checkpoint()
        token.cancel()
        with pytest.raises(CancelledError):
            checkpoint()
    answered()


def test_without_a_token_nothing_stops() -> None:
    checkpoint()
    token = Token()
    token.cancel()
    checkpoint()
    with cancellable(token), pytest.raises(CancelledError):
        checkpoint()
    checkpoint()
    assert issubclass(CancelledError, CalibrantError)
    assert CancelledError.exit_status == 130


@pytest.mark.parametrize("workers", [1, 2])
def test_detection_stops_between_images(workers: int, tmp_path: Path) -> None:
    images = make_files(tmp_path).images
    assert cancelled_after(0.2, lambda: detect(images, target=TARGET, workers=workers)) < WITHIN


def test_the_optimizer_stops_at_its_next_step() -> None:
    scene = intrinsics_scene(20)
    calibrate_intrinsics(scene.observations)
    assert cancelled_after(0.05, lambda: calibrate_intrinsics(scene.observations, model="rational")) < WITHIN


def test_the_doctor_stops_at_its_next_hypothesis(tmp_path: Path) -> None:
    scene = hand_eye_scene("good", views=40, seed=3)
    robot, target = (tmp_path / f"{name}.csv" for name in ("robot", "target"))
    robot.write_text(poses_csv(RobotPoses.from_matrices(scene.robot_poses.T_base_gripper)))
    target.write_text(poses_csv(RobotPoses.from_matrices(scene.measured_T_camera_target)))
    request = doctor.Request(poses=(str(robot),), measured=TargetPoseOptions(target_poses=(str(target),)))
    doctor.run(request)
    assert cancelled_after(0.05, lambda: doctor.run(request)) < WITHIN


@pytest.mark.parametrize("phase", ["Finding boards", "Calibrating"])
def test_a_cancelled_task_writes_nothing(phase: str, tmp_path: Path) -> None:
    files = make_files(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    token = Token()
    listener = CancelsAt(token, phase)
    request = intrinsics.Request(
        photos=PhotoOptions(images=(str(files.images),), target=TARGET),
        search=SearchOptions(cache="none"),
        opencv_yaml=tmp_path / "camera.yml",
    )
    with cancellable(token), pytest.raises(CancelledError):
        intrinsics.run(request, listener)
    assert time.perf_counter() - listener.asked < WITHIN
    assert sorted(tmp_path.rglob("*")) == before


def test_documents_stop_between_two_and_none_is_left(tmp_path: Path) -> None:
    token = Token()
    old = tmp_path / "a.txt"
    old.write_text("mine")

    def late() -> bytes:
        token.cancel()
        return b"second"

    second, third = Document(tmp_path / "new" / "b.txt", late), Document(tmp_path / "c", b"third")
    with cancellable(token), pytest.raises(CancelledError):
        write_documents([Document(old, b"first"), second, third], force=True)
    assert old.read_text() == "mine"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.txt"]


@pytest.mark.parametrize(
    ("name", "phase"),
    [("kinematics", "Identifying"), ("next-pose", "Planning"), ("time-offset", "Aligning"), ("dynamic", "Taking in")],
)
def test_work_on_robots_stops(name: str, phase: str, tmp_path: Path) -> None:
    task = TASKS[name].load()
    request = build(task.Request, ROBOT_CASES[name](make_files(tmp_path)))
    task.run(request, SILENT)  # what a first run compiles is compiled
    token = Token()
    listener = CancelsAt(token, phase)
    with cancellable(token), pytest.raises(CancelledError):
        task.run(request, listener)
    assert listener.asked > 0
    assert time.perf_counter() - listener.asked < WITHIN
