"""The command line run in this process, as the tests of `cli` have it."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from tests.cli.conftest import Outcome
from tests.cli.conftest import calibrant as command_line


@pytest.fixture(scope="session", name="calibrant")
def _calibrant() -> Callable[..., Outcome]:
    return command_line
