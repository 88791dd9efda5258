"""The same answer by every door: the command with --json, its result file, and the verb of Python."""

from __future__ import annotations

import contextlib
import doctest
import inspect
import io
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.contracts.doors import ANSWERS, TARGET, Files, Options, make_files
from tests.contracts.doors import CASES as CELL_CASES
from tests.contracts.doors_robots import ROBOT_CASES

import calibrant as cb
from calibrant.cli.application import run
from calibrant.cli.command import Command
from calibrant.data.result_file import result_text
from calibrant.tasks.options.fields import spread
from calibrant.tasks.registry import TASKS
from calibrant.tasks.signatures import STUB, stub
from calibrant.tasks.verbs import VERBS, verb

CASES = {**CELL_CASES, **ROBOT_CASES}
VERB_OF = {name: own for own, name in VERBS.items()}
WITH_RESULT = [name for name, entry in TASKS.items() if "json" in entry.outputs]
"""Commands that give a result of their own: the others give documents, or show what another gave."""
OF_THE_RUN = ("created", "version")
"""What differs between two runs of one thing."""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    return make_files(tmp_path_factory.mktemp("doors"))


def words_of(name: str, options: Options) -> list[str]:
    """The options as a command line."""
    out: list[str] = name.split()
    for field in spread(TASKS[name].load().Request):
        value = options.get(field.name)
        if value is None or value is False:
            continue
        values = [] if value is True else [str(v) for v in (value if isinstance(value, list | tuple) else [value])]
        out += values if field.option.positional else [field.flag, *values]
    return [*out, *(["--force"] if options.get("force") else [])]


def said(arguments: list[str]) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = run(arguments)
    return status, out.getvalue(), err.getvalue()


def content(text: str) -> dict[str, Any]:
    return {key: value for key, value in json.loads(text).items() if key not in OF_THE_RUN}


def test_every_command_has_a_case() -> None:
    assert set(WITH_RESULT) == {*CASES, *ANSWERS}
    assert {VERB_OF[name] for name in TASKS} <= set(cb.__all__)


SLOW = ("projector calibrate", "scan", "depth", "stereo", "rig")


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.long) if n in SLOW else n for n in CASES])
def test_every_door_gives_the_same_answer(name: str, files: Files, tmp_path: Path) -> None:
    options = CASES[name](files)
    written = tmp_path / "result.json"
    first, printed, error = said([*words_of(name, options), "--json"])
    assert error.count("\n") <= 1, error
    result = verb(VERB_OF[name])(**options)
    assert first == 0, error
    assert result is not None
    by_python = content(result_text(result))
    assert content(printed) == by_python
    if "out" not in TASKS[name].outputs:  # its --out is no result file
        return
    second, _, _ = said([*words_of(name, options), "--out", str(written), "--quiet"])
    assert second == 0
    assert content(written.read_text()) == by_python
    assert cb.read(written).verdict == result.verdict


def test_a_study_is_the_same_from_python_and_from_the_command() -> None:
    from calibrant.studies.page import study_text

    def untimed(text: str) -> dict[str, Any]:
        document = json.loads(text)
        for method in document["methods"]:
            method.pop("milliseconds", None)
        return {**document}

    options = ANSWERS["study methods"]
    status, printed, error = said([*words_of("study methods", options), "--json"])
    assert status == 0, error
    assert untimed(printed) == untimed(study_text(cb.study_methods(**options)))


@pytest.mark.long
def test_a_demo_is_the_same_from_python_and_from_the_command(tmp_path: Path) -> None:
    options = {**ANSWERS["demo"], "out": tmp_path / "demo"}
    status, printed, error = said([*words_of("demo", options), "--json"])
    assert status == 0, error
    by_python = content(result_text(cb.demo(**options)))
    by_command = content(printed)
    assert by_command.pop("truth")["inside"]
    assert by_command == by_python
    assert content((tmp_path / "demo" / "hand-eye.json").read_text()) == by_python


@pytest.mark.parametrize("name", TASKS)
def test_every_verb_says_what_it_takes(name: str) -> None:
    own = verb(VERB_OF[name])
    fields = {f.name for f in spread(TASKS[name].load().Request)}
    parameters = set(inspect.signature(own).parameters)
    assert parameters - fields <= {"force"}
    assert fields <= parameters
    assert ">>> " in (own.__doc__ or "")
    assert all(f.help for f in Command.of(name).fields), "every option has its help below its field"
    if getattr(cb, VERB_OF[name], None) is own:
        assert f"cb.{VERB_OF[name]}(" in (own.__doc__ or "")


def test_the_stub_of_the_verbs_is_up_to_date() -> None:
    assert STUB.read_text(encoding="utf-8") == stub(), "write it again: python -m calibrant.tasks.signatures"


def test_a_name_for_the_only_camera_changes_nothing(files: Files) -> None:
    plain = cb.hand_eye(images=files.images, poses=files.poses, target=TARGET)
    named = cb.hand_eye(images={"camera": files.images}, poses=files.poses, target=TARGET)
    assert [c.name for c in named.checks] == [c.name for c in plain.checks]
    assert content(result_text(named)) == content(result_text(plain))


def test_another_name_of_the_only_camera_changes_no_more_than_its_name(files: Files) -> None:
    plain = cb.hand_eye(images=files.images, poses=files.poses, target=TARGET)
    named = cb.hand_eye(images={"left": files.images}, poses=files.poses, target=TARGET)
    assert [(c.name, c.status) for c in named.checks] == [(c.name, c.status) for c in plain.checks]
    assert named.verdict == plain.verdict
    assert (named.rms_px, named.sigma_px) == (plain.rms_px, plain.sigma_px)
    assert np.array_equal(named.transform("gripper", "left").matrix, plain.transform("gripper", "camera").matrix)


def test_python_is_as_strict_as_the_command(files: Files, tmp_path: Path) -> None:
    with pytest.raises(cb.InputError, match="no images were given"):
        cb.intrinsics(target=TARGET)
    with pytest.raises(TypeError, match="colour"):
        cb.intrinsics(files.images, colour="red")  # type: ignore[call-arg]
    with pytest.raises(cb.InputError, match="takes a text, a path"):
        cb.intrinsics(7, target=TARGET)  # type: ignore[arg-type]
    camera = tmp_path / "camera.yml"
    cb.intrinsics(files.images, target=TARGET, opencv_yaml=camera)
    before = camera.read_bytes()
    with pytest.raises(cb.InputError, match="exists already"):
        cb.intrinsics(files.images, target=TARGET, opencv_yaml=camera)
    assert camera.read_bytes() == before


def test_poses_are_read_in_every_way_or_in_the_one_that_fits(files: Files) -> None:
    every = cb.read_poses(files.poses)
    assert len({n.description for n in every}) == len(every) > 1
    decided = cb.hand_eye(images=files.images, poses=files.poses, target=TARGET)
    assert decided.decided["pose_reading"] == every[0].description
    T = np.stack([v.T_camera_target for v in decided.views])
    (chosen,) = cb.read_poses(files.poses, T_camera_target=T, setup="eye-in-hand")
    assert chosen.description == every[0].description
    with pytest.raises(cb.InputError, match="no option 'units'"):
        cb.read_poses(files.poses, units="mm")


@pytest.mark.long
def test_every_name_is_one_object_before_and_after_all_modules_are_loaded() -> None:
    code = """
import calibrant as cb, importlib, pkgutil
before = {name: getattr(cb, name) for name in cb.__all__}
for module in pkgutil.walk_packages(cb.__path__, "calibrant."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
changed = [name for name, value in before.items() if getattr(cb, name) is not value]
assert not changed, changed
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=250)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", [n for n in cb.__all__ if n != "__version__"])
def test_every_public_name_has_an_example(name: str) -> None:
    documentation = inspect.getdoc(getattr(cb, name)) or ""
    assert any(sign in documentation for sign in (">>> ", "Example::")), f"cb.{name} shows no example"


@pytest.mark.parametrize("name", [n for n in cb.__all__ if n not in VERBS and n != "__version__"])
def test_the_examples_are_true(name: str) -> None:
    value = getattr(cb, name)
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    for test in doctest.DocTestFinder(recurse=False).find(value, name, globs={}):
        runner.run(test)
    assert runner.failures == 0
