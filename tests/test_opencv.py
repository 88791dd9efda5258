"""What an installation of OpenCV can suffer from, on folders as pip leaves them: said in words, with the cure."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
import warnings
from pathlib import Path
from types import ModuleType

import pytest

from calibrant.errors import CalibrantError
from calibrant.opencv import NEEDED, OLDEST, OpenCVError, check_opencv, cv2, wheels_in

ROOT = Path(__file__).resolve().parents[1]


def site(folder: Path, *wheels: str) -> Path:
    """A folder of packages in which pip installed these wheels, each name-version."""
    for wheel in (*wheels, "numpy-2.4.0", "opencv_stubs-1.0"):
        (folder / f"{wheel}.dist-info").mkdir(parents=True)
    return folder


def module(version: str) -> ModuleType:
    """A cv2 that has all that is needed."""
    made = ModuleType("cv2")
    for name in NEEDED:
        setattr(made, name, version)
    return made


def test_wheels_are_found_by_name_and_version(tmp_path: Path) -> None:
    folder = site(tmp_path, "opencv_python-4.8.1.78", "opencv_contrib_python_headless-5.0.0.93")
    assert wheels_in(folder) == {"opencv-contrib-python-headless": "5.0.0.93", "opencv-python": "4.8.1.78"}
    assert wheels_in(tmp_path / "nowhere") == {}


@pytest.mark.parametrize(
    "wheels",
    [(), ("opencv_python_headless-5.0.0.93",), ("opencv_python-5.0.0.93", "opencv_python_headless-5.0.0.93")],
    ids=["built by hand", "one", "two of one version"],
)
def test_a_whole_opencv_passes_in_silence(tmp_path: Path, wheels: tuple[str, ...]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_opencv(module("5.0.0"), site(tmp_path, *wheels))
        check_opencv(cv2, tmp_path)


def test_two_versions_are_warned_of(tmp_path: Path) -> None:
    folder = site(tmp_path, "opencv_python-4.13.0.92", "opencv_python_headless-5.0.0.93")
    with pytest.warns(UserWarning, match="OpenCV answers") as caught:
        check_opencv(module("5.0.0"), folder)
    text = str(caught[0].message)
    for words in (
        "answers with version 5.0.0",
        "opencv-python 4.13.0.92, opencv-python-headless 5.0.0.93 are installed",
        "pip uninstall -y opencv-python opencv-python-headless, then pip install 'opencv-python-headless>=4.12,<6'",
    ):
        assert words in text.replace("Opencv", "opencv")


@pytest.mark.parametrize(
    ("loaded", "reason", "said"),
    [
        (None, "ImportError: libGL.so.1", "cannot be loaded: ImportError: libGL.so.1"),
        (ModuleType("cv2"), "", "is torn: cv2 has no __version__, aruco"),
        (module("4.8.1"), "", "is 4.8.1, expected 4.12 or later"),
    ],
    ids=["does not load", "torn", "old"],
)
@pytest.mark.parametrize(
    ("wheels", "cure"),
    [
        ((), "To mend it, install it: pip install"),
        (("opencv_python-4.8.1.78",), "pip uninstall -y opencv-python, then pip install"),
        (
            ("opencv_python-4.8.1.78", "opencv_python_headless-5.0.0.93"),
            "write the same folder cv2. To mend it, keep one of them: "
            "pip uninstall -y opencv-python opencv-python-headless, then pip install",
        ),
    ],
    ids=["none", "one", "two"],
)
def test_a_broken_opencv_is_an_error_with_the_cure(
    tmp_path: Path, loaded: ModuleType | None, reason: str, said: str, wheels: tuple[str, ...], cure: str
) -> None:
    with pytest.raises(OpenCVError) as caught:
        check_opencv(loaded, site(tmp_path, *wheels), reason)
    assert isinstance(caught.value, CalibrantError)
    assert said in str(caught.value)
    assert cure in str(caught.value)
    assert str(tmp_path) in str(caught.value)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (
            "raise ImportError('libGL.so.1: cannot open shared object file')",
            "OpenCV cannot be loaded: ImportError: lib",
        ),
        (None, "OpenCV is torn: cv2 has no __version__"),
    ],
    ids=["no library", "an empty folder"],
)
def test_a_command_says_it_without_a_traceback(tmp_path: Path, content: str | None, said: str) -> None:
    folder = site(tmp_path / "site", "opencv_python-4.8.1.78", "opencv_python_headless-5.0.0.93")
    (folder / "cv2").mkdir()
    # Removing one of two wheels leaves a folder with what the other did not write: a module of nothing.
    (folder / "cv2" / "__init__.py").write_text(content or "")
    (tmp_path / "photo.png").write_bytes(b"")
    command = [sys.executable, "-m", "calibrant", "detect", "photo.png", "--target", "chessboard:9x6:25mm"]
    places = os.pathsep.join((str(folder), str(ROOT / "src"), os.environ.get("PYTHONPATH", "")))
    environment = {**os.environ, "PYTHONPATH": places}
    run = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, env=environment)
    assert run.returncode == 2, run.stderr
    assert said in run.stderr
    assert "pip uninstall -y opencv-python opencv-python-headless" in run.stderr
    assert "Traceback" not in run.stderr


def test_the_oldest_version_is_the_required_one() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert f"opencv-python-headless>={'.'.join(map(str, OLDEST))},<6" in project["dependencies"]


def test_opencv_has_one_door() -> None:
    """Elsewhere `import cv2` would load it unlooked at."""
    source = ROOT / "src" / "calibrant"
    plain = re.compile(r"^ *import cv2$", re.MULTILINE)
    own = [file.relative_to(source) for file in source.rglob("*.py") if plain.search(file.read_text(encoding="utf-8"))]
    assert [str(file) for file in own] == []
    assert "import cv2 as cv2" in (source / "opencv.py").read_text()
