"""Words while a command works: a bar on a terminal, plain lines in a file or a pipe, nothing where nobody waits."""

from __future__ import annotations

import io
import subprocess
import sys
import time
from pathlib import Path

import pytest

from calibrant.cli import progress
from calibrant.cli.progress import LinesListener, TerminalListener, listener
from calibrant.tasks.listener import SILENT


def test_what_is_quick_is_not_said() -> None:
    stream = io.StringIO()
    with LinesListener(stream).status("Calibrating …"):
        pass
    assert stream.getvalue() == ""


def test_what_takes_longer_is_said_within_the_first_second(monkeypatch: pytest.MonkeyPatch) -> None:
    stream, begun = io.StringIO(), time.monotonic()
    with LinesListener(stream).status("Calibrating …"):
        while not stream.getvalue():
            time.sleep(0.01)
    assert time.monotonic() - begun < 1.0
    assert stream.getvalue() == "Calibrating …\n"


def test_a_count_is_a_line_every_few_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "EVERY", 0.2)
    monkeypatch.setattr(progress, "FIRST", 60.0)
    stream = io.StringIO()
    with LinesListener(stream).progress("Finding boards") as step:
        for done in range(1, 31):
            step(done, 30, f"{done}.png")
            time.sleep(0.02)
    lines = stream.getvalue().splitlines()
    assert 1 <= len(lines) <= 4
    assert all(line.startswith("Finding boards ") and line.endswith("/30") for line in lines)


def test_nobody_is_told_where_nobody_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    assert listener(silent=True) is SILENT
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    assert listener(silent=False) is SILENT


def test_a_file_gets_lines_and_a_terminal_a_bar(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with open(tmp_path / "err.txt", "w", encoding="utf-8") as stream:
        monkeypatch.setattr(sys, "stderr", stream)
        assert isinstance(listener(silent=False), LinesListener)
        monkeypatch.setattr(stream, "isatty", lambda: True, raising=False)
        assert isinstance(listener(silent=False), TerminalListener)


@pytest.mark.parametrize("how", [(), ("--quiet",), ("--json",)])
def test_a_pipe_hears_what_takes_long(how: tuple[str, ...], cell) -> None:
    arguments = ["detect", str(cell.images), "--target", "chessboard:7x6:30mm", "--cache", "none", *how]
    # The compiled code of this machine is left where it is: half a second without words is set to none instead.
    code = (
        "import sys; from calibrant.cli import progress; from calibrant.cli.application import run\n"
        f"progress.FIRST = 0.0; sys.exit(run({arguments!r}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=250)
    assert done.returncode == 0
    assert done.stderr.startswith("Finding boards") if how == () else done.stderr == ""
