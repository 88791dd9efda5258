"""Every option that a message of the house names is one of a command, and Python hears of its arguments instead."""

from __future__ import annotations

import ast
import inspect
import pickle
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from docs.house import parsed

import calibrant
from calibrant.advice import python_door
from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.cli.command import Command
from calibrant.simulate.scenes import intrinsics_scene
from calibrant.tasks.registry import TASKS

PACKAGE = Path(calibrant.__file__).parent
FOREIGN = {"--help", "--version", "--install-completion", "--no-deps"} | {
    f"--{name}" for name in ("frame-id", "child-frame-id", "roll", "pitch", "yaw", "qx", "qy", "qz", "qw", "ros-args")
}
"""Of no command, of pip, and of ROS's static_transform_publisher."""
OTHERS = {"reports/printed.py": "calls a browser, with the browser's options"}


def test_advice_names_options_that_there_are() -> None:
    known = FOREIGN | {field.flag for name in TASKS for field in Command.of(name).fields}
    strange = []
    for path in sorted(PACKAGE.rglob("*.py")):
        if path.relative_to(PACKAGE).as_posix() in OTHERS:
            continue
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                named = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*[a-z]\b(?!-)", node.value)) - known
                strange += [f"{path.relative_to(PACKAGE)}:{node.lineno}: {flag}" for flag in sorted(named)]
    assert not strange, "\n".join(strange)


DOORS = [
    name
    for name, (module, attribute) in calibrant._PUBLIC.items()
    if module != "calibrant.tasks.verbs" and inspect.isfunction(getattr(calibrant, name))
]
"""Public functions that are not verbs."""
ROOMS_OF_CLASSES = ("cameras", "data", "geometry", "targets", "optimize")
"""Where the public classes stand: their methods answer all doors alike."""


def test_errors_of_every_public_function_name_arguments() -> None:
    assert set(DOORS) >= {"calibrate_intrinsics", "calibrate_hand_eye", "detect", "read", "read_poses", "write_report"}
    for name in DOORS:
        door = getattr(calibrant, name)
        assert door.__wrapped__.__module__ != "calibrant"
        assert pickle.loads(pickle.dumps(door)) is door  # as a process pool sends it
        assert inspect.signature(door) == inspect.signature(door.__wrapped__)


def two_views() -> calibrant.Observations:
    return intrinsics_scene(2).observations


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda _: calibrant.calibrate_intrinsics(two_views(), model="auto"), "Name a model: model brown"),
        (lambda _: calibrant.calibrate_intrinsics(two_views(), fix=("focal",)), "its value: initial camera.json"),
        (lambda _: calibrant.calibrate_intrinsics(two_views(), max_error_px=1e-6), "Raise max_error_px, or"),
        (
            lambda folder: calibrant.write_report(calibrant.CalibrationResult("pose", "ok"), folder / "old"),
            "force=True",
        ),
    ],
)
def test_an_error_of_a_function_names_its_arguments(
    wrong: Callable[[Path], object], words: str, tmp_path: Path
) -> None:
    (tmp_path / "old").touch()
    with pytest.raises(calibrant.CalibrantError, match=words) as said:
        wrong(tmp_path)
    assert "--" not in str(said.value)


def test_a_command_hears_options_of_the_same_function() -> None:
    with pytest.raises(calibrant.InputError, match="Name a model: --model brown"):
        calibrate_intrinsics(two_views(), model="auto")


def test_a_command_line_in_an_error_stays_one() -> None:
    def fails(*, max_error_px: float = 1.0, pose: int = 0) -> None:
        raise calibrant.RefusedError("raise --max-error 2px or --exclude a; calibrant intrinsics --fix-all, --force")

    with pytest.raises(calibrant.RefusedError) as said:
        python_door(fails, "fails")()
    assert str(said.value) == "raise max_error_px 2px or exclude a; calibrant intrinsics --fix-all, force=True"


@pytest.mark.parametrize("room", ROOMS_OF_CLASSES)
def test_classes_that_python_uses_name_no_option(room: str) -> None:
    said = [
        f"{path.relative_to(PACKAGE)}:{node.lineno}: {node.exc and ast.unparse(node.exc)}"
        for path in sorted((PACKAGE / room).rglob("*.py"))
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.Raise) and node.exc and re.search(r"(?<![\w-])--[a-z]", ast.unparse(node.exc))
    ]
    assert not said, "\n".join(said)
