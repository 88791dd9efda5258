"""Shared fixtures: real data, found beside the project and skipped with the reason where it is missing."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("the same in every run", derandomize=True, database=None, deadline=None)
settings.load_profile("the same in every run")

SHARED = Path(__file__).resolve().parents[1].parent / "shared"
SHARED_DATA = SHARED / "data"


def pytest_sessionstart(session: pytest.Session) -> None:
    """Where the whole suite runs, its workers compile from both ends of the list of kernels and meet in the middle.

    On a machine that has compiled nothing yet each would else compile all of them in the same order, at the same time.
    A kernel is compiled when its module loads, and loaded where another process has compiled it.
    """
    worker = getattr(session.config, "workerinput", None)
    if worker is None or [Path(a).resolve() for a in session.config.args] != [Path(__file__).parent]:
        return
    package = Path(__file__).resolve().parents[1] / "src"
    kernels = [f for f in sorted(package.rglob("*.py")) if "from calibrant.compiled import" in f.read_text("utf-8")]
    backward = int(worker["workerid"].removeprefix("gw")) % 2
    for file in reversed(kernels) if backward else kernels:
        import_module(".".join(file.relative_to(package).with_suffix("").parts))


@pytest.fixture(scope="session")
def shared_data() -> Callable[[str], Path]:
    """The folder of a real data set by name; the test is skipped where it is not there."""

    def folder(name: str) -> Path:
        path = SHARED_DATA / name
        if not path.is_dir():
            pytest.skip(f"real data set {name} not found beside the project, in ../shared/data")
        return path

    return folder


@pytest.fixture(scope="session")
def shared_case() -> Callable[[str], Path]:
    """The folder of a case from the field by name; the test is skipped where it is not there."""

    def folder(name: str) -> Path:
        path = SHARED / "cases" / name
        if not path.is_dir():
            pytest.skip(f"case {name} not found beside the project, in ../shared/cases")
        return path

    return folder


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Detections are cached in a folder of this run: what an earlier run found must not answer for this one."""
    before = os.environ.get("XDG_CACHE_HOME")
    os.environ["XDG_CACHE_HOME"] = str(tmp_path_factory.mktemp("cache"))
    yield
    if before is None:
        del os.environ["XDG_CACHE_HOME"]
    else:
        os.environ["XDG_CACHE_HOME"] = before
