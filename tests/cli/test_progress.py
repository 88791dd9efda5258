"""Words while a command works: a bar on a terminal, plain lines in a file or a pipe, nothing where nobody waits."""

from __future__ import annotations

import io
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from calibrant import cli
from calibrant.cli import progress
from calibrant.cli.application import run
from calibrant.cli.progress import LinesListener, TerminalListener, listener
from calibrant.cli.words import clean, console, say_json
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


EVIL = "photo\x1b]0;owned\x07\x9b31m\u202egnp.[/bold]:smile:"
SHOWN = "photo\\x1b]0;owned\\x07\\x9b31m\\u202egnp.[/bold]:smile:"


def test_codes_are_shown_and_not_sent(capsys: pytest.CaptureFixture[str]) -> None:
    assert clean(EVIL) == SHOWN
    assert clean("two\nlines\tand a tab, 25 °C, 校正") == "two\nlines\tand a tab, 25 °C, 校正"
    shown = console(width=200)
    shown.file = io.StringIO()
    shown.print(EVIL)
    assert shown.file.getvalue() == SHOWN.replace(r"\x07", "") + "\n"  # Rich drops the bell itself
    say_json(json.dumps({"file": EVIL}, ensure_ascii=False))
    text = capsys.readouterr().out
    assert json.loads(text) == {"file": EVIL}
    assert not set("\x1b\x07\x9b\u202e") & set(text)


def test_a_name_of_codes_in_an_error_and_in_what_was_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / f"{EVIL.replace('/', '-')}.json").write_text("{")
    assert run(["report", str(tmp_path / f"{EVIL.replace('/', '-')}.json")]) == 2
    assert "\x1b" not in capsys.readouterr().err
    assert run(["target", "chessboard:3x3:10mm", "--out", str(tmp_path / "b\x1b[31m.svg")]) == 0
    out = capsys.readouterr().out
    assert "b\\x1b[31m.svg" in out
    assert "\x1b" not in out


def test_an_interrupt_before_the_command_line_is_loaded(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stopped() -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "_run", stopped)
    before = signal.getsignal(signal.SIGINT)
    try:
        with pytest.raises(SystemExit) as ended:
            cli.main()
    finally:
        signal.signal(signal.SIGINT, before)
    assert ended.value.code == 130
    assert capsys.readouterr().err == "calibrant: interrupted; no result was written\n"
