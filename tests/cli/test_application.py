"""The command as a whole: help, exit statuses, values spread over options, and the light start."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from calibrant.cli.command import Command, parse, values_of
from calibrant.tasks.registry import TASKS

COMMANDS = ["demo", "target", "detect", "intrinsics", "hand-eye", "report"]
LISTED = list(dict.fromkeys(name.split()[0] for name in TASKS))


def process(*arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    code = "from calibrant.cli import main; main()"
    command = [sys.executable, "-c", code, *(str(a) for a in arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, timeout=60)


@pytest.mark.parametrize("command", [[], *([c] for c in COMMANDS)])
def test_help_explains_without_loading_the_heavy_libraries(command: list[str]) -> None:
    code = (
        "import sys; from calibrant.cli.application import run\n"
        f"status = run({[*command, '--help']!r})\n"
        "heavy = [m for m in ('numpy', 'cv2', 'scipy', 'numba', 'matplotlib') if m in sys.modules]\n"
        "sys.exit(f'{status} {heavy}' if status or heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    assert "Usage: calibrant" in done.stdout
    if not command:
        assert [name for name in LISTED if f"  {name} " not in done.stdout] == []
        assert "..." not in done.stdout.split("Commands:")[1]  # no description is cut


def test_nothing_at_all_shows_the_help(calibrant) -> None:
    outcome = calibrant()
    assert outcome.status == 0
    assert "Commands:" in outcome.out


def test_an_unknown_command_is_unusable_input(calibrant) -> None:
    outcome = calibrant("calibrate")
    assert (outcome.status, outcome.out) == (2, "")
    assert outcome.err == "calibrant: No such command 'calibrate'. See calibrant --help.\n"


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        (["intrinsic"], "'intrinsic' (did you mean intrinsics?). See calibrant --help."),
        (["tool", "tuch"], "'tool tuch' (did you mean touch?). See calibrant tool --help."),
        (["--versoin"], "'--versoin' (did you mean --version?). See calibrant --help."),
        (["intrinsics", "a.png", "--targt", "x"], "--targt (did you mean --target?). See calibrant intrinsics --help."),
    ],
)
def test_a_misspelt_word_is_asked_back(calibrant, given: list[str], meant: str) -> None:
    outcome = calibrant(*given)
    assert (outcome.status, outcome.out) == (2, "")
    assert outcome.err.endswith(f"{meant}\n")


@pytest.mark.parametrize("columns", [40, 80, 120])
def test_help_fits_the_terminal_and_stays_readable(calibrant, monkeypatch, columns: int) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    options = calibrant("hand-eye", "--help").out.split("Options:")[1].splitlines()
    words = [line for line in options if not line.lstrip().startswith("-")]
    assert max(map(len, words)) <= columns
    # Words are read, not spelt: their column is half of a narrow terminal, not what the names have left.
    assert max(len(line.strip()) for line in words) >= min(columns, 80) // 2 - 4
    assert not any(line.endswith("-") for line in options if len(line) < columns)


def test_help_says_what_holds_without_an_option(calibrant) -> None:
    words = " ".join(calibrant("study", "methods", "--help").out.split())
    assert "--views N Simulated views. Default: 6." in words
    assert "Write an HTML report here. Default" not in words  # nothing, where nothing is done
    assert "Camera model, as of intrinsics. Default: brown." in " ".join(calibrant("capture", "--help").out.split())


def test_figures_are_whole_on_a_narrow_terminal(calibrant, monkeypatch) -> None:
    """A line that is too long is folded by the terminal; a figure that is cut is lost."""
    file = Path(__file__).parents[1] / "data" / "format_one" / "hand-eye.json"
    wide = calibrant("report", file).out
    monkeypatch.setenv("COLUMNS", "30")
    narrow = calibrant("report", file).out
    assert narrow.count("…") <= wide.count("…")
    assert max(map(len, narrow.splitlines())) <= 72


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
@pytest.mark.parametrize("command", [["--help"], ["report", "hand-eye.json"]])
def test_output_that_cannot_be_written_is_said(command: list[str]) -> None:
    folder = Path(__file__).parents[1] / "data" / "format_one"
    with open("/dev/full", "w") as full:
        arguments = [sys.executable, "-u", "-m", "calibrant", *command]
        done = subprocess.run(arguments, stdout=full, stderr=subprocess.PIPE, text=True, cwd=folder, timeout=60)
    assert done.returncode == 2
    assert done.stderr.startswith("calibrant: cannot write to standard output: No space left on device")


def test_exit_status_and_streams_of_a_process(tmp_path: Path) -> None:
    done = process("intrinsics", "none.png", "--target", "chessboard:9x6:25mm", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "calibrant: image none.png does not exist\n"


def test_the_traceback_only_with_debug(tmp_path: Path) -> None:
    done = process("intrinsics", "none.png", "--target", "chessboard:9x6:25mm", "--debug", cwd=tmp_path)
    assert done.returncode == 2
    assert "Traceback" in done.stderr
    assert done.stderr.endswith("calibrant: image none.png does not exist\n")


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("hand-eye --images a b --poses p", "hand-eye --images a --images b --poses p"),
        ("hand-eye -i a b --poses p", "hand-eye -i a -i b --poses p"),
    ],
)
def test_values_up_to_the_next_option_are_spread(given: str, expected: str) -> None:
    requests = [parse(Command.of("hand-eye"), words.split()[1:]).request for words in (given, expected)]
    assert requests[0] == requests[1]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("intrinsics a b --exclude c d --out o", "intrinsics a b --exclude c --exclude d --out o"),
        ("intrinsics --fix k3 p1,p2 a.png b/c", "intrinsics a.png b/c --fix k3 --fix p1,p2"),
        ("intrinsics --json a b", "intrinsics a b --json"),
        ("intrinsics a --fix k3 --out o b", "intrinsics a b --out o --fix k3"),
    ],
)
def test_values_up_to_the_next_option_belong_to_their_option(given: str, expected: str) -> None:
    first, second = (values_of(Command.of(words.split()[0]), words.split()[1:]) for words in (given, expected))
    assert first == second
    assert first["images"] in [("a", "b"), ("a.png", "b/c")]
