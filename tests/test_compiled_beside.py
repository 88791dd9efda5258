"""The second process of a first run: started at the first compilation, waited for, and gone with its block."""

from __future__ import annotations

from pathlib import Path

import pytest
from numba.core import event

from calibrant.cancel import CancelledError, Token, cancellable
from calibrant.compiled_beside import compiled_beside

MARK = "import pathlib; pathlib.Path(__file__).with_suffix('.done').touch()\n"


@pytest.fixture(autouse=True)
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("calibrant.compiled_beside._cores", lambda: 2)


def module(folder: Path, name: str, text: str, monkeypatch: pytest.MonkeyPatch) -> str:
    (folder / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(str(folder))
    return name


def compile_something() -> None:
    """What Numba says when it begins, and when it is done."""
    with event.trigger_event("numba:compile", data={}):
        pass


def test_where_nothing_is_compiled_no_process_starts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with compiled_beside(module(tmp_path, "marks_a", MARK, monkeypatch)) as other:
        assert not other.runs
        other.wait()
    assert not (tmp_path / "marks_a.done").exists()


def test_the_first_compilation_is_told_once() -> None:
    told: list[str] = []
    with compiled_beside("json", first=lambda: told.append("first")):
        assert told == []
        compile_something()
        compile_something()
    assert told == ["first"]


def test_a_compilation_starts_it_and_its_modules_are_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = [module(tmp_path, name, MARK, monkeypatch) for name in ("marks_b", "marks_c")]
    with compiled_beside(*names) as other:
        compile_something()
        compile_something()
        other.wait()
        assert not other.runs
    assert all((tmp_path / f"{name}.done").exists() for name in names)


def test_after_the_block_it_does_not_run_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with compiled_beside(module(tmp_path, "sleeps", "import time; time.sleep(600)\n", monkeypatch)) as other:
        compile_something()
        assert other.runs
    assert not other.runs


def test_a_module_that_fails_is_left_to_this_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with compiled_beside(module(tmp_path, "fails", "raise SystemExit(3)\n", monkeypatch)) as other:
        compile_something()
        other.wait()


def test_on_one_core_there_is_no_second_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("calibrant.compiled_beside._cores", lambda: 1)
    with compiled_beside(module(tmp_path, "marks_d", MARK, monkeypatch)) as other:
        compile_something()
        assert not other.runs


def test_waiting_can_be_cancelled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    token = Token()
    with (
        cancellable(token),
        compiled_beside(module(tmp_path, "sleeps_too", "import time; time.sleep(600)\n", monkeypatch)) as other,
    ):
        compile_something()
        token.cancel()
        with pytest.raises(CancelledError):
            other.wait()
