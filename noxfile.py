"""Sessions of nox: the tests on every supported OpenCV, and the linters. `nox -l` lists them.

Each session builds its own environment with pip; the tests themselves use no network.
"""

from __future__ import annotations

import nox

nox.options.sessions = ["lint", "tests"]
nox.options.reuse_existing_virtualenvs = True

OPENCV = ["4.12.0.88", "4.13.0.92", "4.14.0.94", "5.0.0.93"]
"""The last release of each minor version that pyproject.toml admits."""


@nox.session(python=False)
def lint(session: nox.Session) -> None:
    """Formatting, lint rules and types, with the tools of the current environment."""
    session.run("ruff", "format", "--check", "src", "tests", "noxfile.py")
    session.run("ruff", "check", "src", "tests", "noxfile.py")
    session.run("mypy")


@nox.session
@nox.parametrize("opencv", OPENCV, ids=OPENCV)
def tests(session: nox.Session, opencv: str) -> None:
    """The suite with one OpenCV release; arguments after -- go to pytest."""
    # In one step: an OpenCV put over another would leave files of both in the one folder cv2.
    session.install("-e", ".[dev]", f"opencv-python-headless=={opencv}")
    session.run("python", "-c", f"import cv2; v = cv2.__version__; assert v == '{opencv.rpartition('.')[0]}', v")
    session.run("pytest", *session.posargs)


@nox.session
def opencv_contrib(session: nox.Session) -> None:
    """The environment in which tests/peers.py asks cv2.omnidir; with it the tests that else are skipped run."""
    session.install("opencv-contrib-python-headless==5.0.0.93")
    session.run("python", "-c", "import cv2; cv2.omnidir")


@nox.session
def coverage(session: nox.Session) -> None:
    """Which lines no test runs, in one process: half an hour. Compiled functions are left out."""
    session.install("-e", ".[dev]")
    session.run("coverage", "run", "-m", "pytest", "-n", "0", *(session.posargs or ["-m", ""]))
    session.run("coverage", "report", "--show-missing", "--skip-covered")


@nox.session
def docs(session: nox.Session) -> None:
    """The documentation as a site in build/site; every link and every shown file must be there."""
    session.install("-e", ".[docs]")
    session.run("mkdocs", "build", "--strict", *session.posargs, env={"NO_MKDOCS_2_WARNING": "1"})
