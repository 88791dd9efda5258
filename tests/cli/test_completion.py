"""Completion in bash, as a person meets it: commands, options, words to choose from, and files everywhere."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

BASH = shutil.which("bash")
ASK = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMP_LINE="$*"; COMP_POINT=${#COMP_LINE}; COMPREPLY=()
_calibrant calibrant "${COMP_WORDS[-1]}" "${COMP_WORDS[-2]}"
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if BASH is None or sys.platform == "win32":
        pytest.skip("no bash on this machine")
    home = tmp_path_factory.mktemp("home")
    environment = {**os.environ, "HOME": str(home), "SHELL": BASH}
    environment.pop("XDG_DATA_HOME", None)
    command = [sys.executable, "-m", "calibrant", "--install-completion"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=True)
    assert "start-up file" in done.stdout
    path = Path(done.stdout.splitlines()[0].removeprefix("Written: "))
    assert "complete -o filenames" in path.read_text()
    return path


def offered(script: Path, *words: str) -> list[str]:
    command = [BASH or "", "-c", ASK, "bash", str(script), "calibrant", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout.split()


def test_commands_and_options(script: Path) -> None:
    assert offered(script, "intr") == ["intrinsics"]
    assert set(offered(script, "tool", "")) == {"touch", "seen", "self-visibility"}
    assert "--pose-units" in offered(script, "hand-eye", "--pose-")


def test_words_to_choose_from(script: Path) -> None:
    assert offered(script, "intrinsics", "--target-shape", "") == ["flat", "paraboloid", "free"]
    assert "kannala_brandt" in offered(script, "intrinsics", "--model", "")
    assert offered(script, "hand-eye", "--setup", "eye-i") == ["eye-in-hand"]
    assert offered(script, "doctor", "--setup", "eye-i") == ["eye-in-hand"]
    assert offered(script, "hand-eye", "--robot-format", "k") == ["kuka", "kawasaki"]


@pytest.mark.parametrize("before", [["intrinsics"], ["hand-eye", "--images"], ["hand-eye", "--poses"], ["report"]])
def test_files(script: Path, tmp_path: Path, before: list[str]) -> None:
    (tmp_path / "photo1.png").touch()
    assert offered(script, *before, str(tmp_path / "pho")) == [str(tmp_path / "photo1.png")]
