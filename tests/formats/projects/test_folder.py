"""A project on the disk: whole or not at all, one writer at a time, whoever is killed when."""

from __future__ import annotations

import multiprocessing
import os
import random
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.formats.projects import folder as on_disk
from calibrant.formats.projects.edits import with_component, with_kept
from calibrant.formats.projects.folder import create, kept_result, read_kept, read_project, update, writing
from calibrant.formats.projects.lock import LOCK_FILE, locked
from calibrant.formats.projects.records import MOST_OF_JOURNAL, Component, Project

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="a process is killed by a signal")


def with_frame(project: Project, name: str) -> Project:
    return with_component(project, name, Component(kind="frame"))


def test_a_project_is_made_once(tmp_path: Path) -> None:
    create(tmp_path / "cell", Project(), command="calibrant project new")
    with pytest.raises(InputError, match="already; nothing was changed"):
        create(tmp_path / "cell", Project(), command="calibrant project new")
    assert read_project(tmp_path / "cell") == read_project(tmp_path / "cell" / "calibrant.yaml")
    with pytest.raises(InputError, match="there is no project in"):
        read_project(tmp_path)


def test_what_a_project_cannot_be_is_not_written(tmp_path: Path) -> None:
    create(tmp_path, Project(), command="calibrant project new")
    before = (tmp_path / "calibrant.yaml").read_bytes()
    with pytest.raises(InputError, match="no camera called 'left'"):
        update(tmp_path, lambda p: replace(p, components={"r": Component(kind="rig", cameras=("left",))}), command="")
    assert (tmp_path / "calibrant.yaml").read_bytes() == before


def test_a_second_writer_is_refused_and_told_of_the_first(tmp_path: Path) -> None:
    create(tmp_path, Project(), command="calibrant project new")
    with writing(tmp_path) as held:
        said = f"being written by process {os.getpid()} on "
        with pytest.raises(InputError, match=said), writing(tmp_path, wait_s=0.05):
            pass
        held.write(with_frame(held.project, "table"), command="first")
    assert list(update(tmp_path, partial(with_frame, name="wall"), command="second").components) == ["table", "wall"]


def _hold(folder: Path, ready: object) -> None:
    with locked(folder):
        ready.set()  # type: ignore[attr-defined]
        time.sleep(60)


@POSIX
def test_a_dead_process_holds_nothing(tmp_path: Path) -> None:
    create(tmp_path, Project(), command="calibrant project new")
    fork = multiprocessing.get_context("fork")
    ready = fork.Event()
    other = fork.Process(target=_hold, args=(tmp_path, ready))
    other.start()
    assert ready.wait(10)
    with pytest.raises(InputError, match=f"process {other.pid} on"), writing(tmp_path, wait_s=0):
        pass
    other.kill()
    other.join()
    update(tmp_path, partial(with_frame, name="table"), command="after")
    assert (tmp_path / LOCK_FILE).exists()


def _write_on(folder: Path, ready: object) -> None:
    """Writes the project with another result each time, until it is killed."""
    for n in range(100_000):
        with writing(folder) as held:
            kept, text = kept_result(CalibrationResult("cameras", "ok", created=str(n)), of="cell", name="cell")
            name = f"frame {n}"
            held.write(with_kept(replace(held.project, components={name: Component(kind="frame")}), kept),
                       command=f"write {n}", results={kept.file: text})  # fmt: skip
            ready.set()  # type: ignore[attr-defined]


@POSIX
@pytest.mark.parametrize("kills", [10, pytest.param(200, marks=pytest.mark.long)])
def test_a_writer_killed_at_any_moment_leaves_a_project_that_opens(tmp_path: Path, kills: int) -> None:
    create(tmp_path, Project(), command="calibrant project new")
    fork, rng = multiprocessing.get_context("fork"), random.Random(15)
    for _ in range(kills):
        ready = fork.Event()
        other = fork.Process(target=_write_on, args=(tmp_path, ready))
        other.start()
        assert ready.wait(10)
        time.sleep(rng.uniform(0, 0.008))
        other.kill()
        other.join()
        found = read_project(tmp_path)
        assert read_kept(tmp_path, found.results[0]).kind == "cameras"
    assert found.journal[-1].command.startswith("write ")
    assert found.earlier + len(found.journal) > kills
    update(tmp_path, partial(with_frame, name="table"), command="after")
    assert {p.name for p in tmp_path.iterdir()} == {"calibrant.yaml", "results", LOCK_FILE}
    assert [p.name for p in (tmp_path / "results").iterdir()] == [Path(found.results[0].file).name]


def test_what_cannot_be_moved_into_place_leaves_the_project_of_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    create(tmp_path, Project(), command="calibrant project new")
    before = (tmp_path / "calibrant.yaml").read_bytes()

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(InputError, match="no space left"):
        update(tmp_path, partial(with_frame, name="table"), command="x")
    monkeypatch.undo()
    assert (tmp_path / "calibrant.yaml").read_bytes() == before


def test_a_result_changed_by_another_hand_is_named(tmp_path: Path) -> None:
    kept, text = kept_result(CalibrationResult("cameras", "ok"), of="given", name="rig.json")
    made = create(tmp_path, replace(Project(), results=(kept,)), command="x", results={kept.file: text})
    file = tmp_path / made.results[0].file
    file.write_text(file.read_text() + " ")
    with pytest.raises(InputError, match="changed by another hand"):
        read_kept(tmp_path, made.results[0])
    file.unlink()
    with pytest.raises(InputError, match="its file is gone"):
        read_kept(tmp_path, made.results[0])


def test_the_journal_keeps_the_last_commands_and_the_number_of_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(on_disk, "MOST_OF_JOURNAL", 3)
    assert MOST_OF_JOURNAL > 100
    create(tmp_path, Project(), command="0")
    for n in range(1, 6):
        found = update(tmp_path, lambda p: p, command=str(n))
    assert ([e.command for e in found.journal], found.earlier) == (["3", "4", "5"], 3)


def test_paths_below_the_folder_move_with_it_and_others_stay(tmp_path: Path) -> None:
    assert on_disk.inside(tmp_path, tmp_path / "photos" / "*.png") == "photos/*.png"
    assert on_disk.inside(tmp_path / "cell", tmp_path / "photos") == (tmp_path / "photos").as_posix()
