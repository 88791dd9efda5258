"""Cells for the tests, and whether this machine can draw them."""

from __future__ import annotations

from functools import cache

import pytest

pytest.importorskip("mujoco", reason="the robot cell needs MuJoCo: pip install 'calibrant[sim]'")

from calibrant.simulate.robot_cell.pictures.opengl import open_context


@cache
def no_opengl() -> str | None:
    """Why pictures cannot be drawn by OpenGL here; None where they can."""
    opened = open_context()
    return opened if isinstance(opened, str) else None


def needs_opengl() -> pytest.MarkDecorator:
    """Skips a test, with the reason, where there is no OpenGL."""
    return pytest.mark.skipif(no_opengl() is not None, reason=f"no OpenGL here: {no_opengl()}")
