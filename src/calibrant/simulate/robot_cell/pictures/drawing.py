"""Which renderer draws the cell: EGL, else OSMesa, else rays, and why."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calibrant.simulate.robot_cell.pictures.opengl import OpenGLRenderer, open_context
from calibrant.simulate.robot_cell.pictures.rays import RayRenderer
from calibrant.simulate.robot_cell.pictures.views import Renderer
from calibrant.simulate.robot_cell.world.light import Light

if TYPE_CHECKING:
    from calibrant.simulate.robot_cell.world.physics import World


def choose_renderer(world: World, light: Light, *, shadows: bool) -> tuple[Renderer, str]:
    """A renderer for the world, and one sentence on what draws and why."""
    opened = open_context()
    if isinstance(opened, str):
        return RayRenderer(world, light), f"pictures are drawn by casting rays, slowly: no OpenGL ({opened})"
    name, context = opened
    return OpenGLRenderer(world, name, context, shadows=shadows), f"pictures are drawn by OpenGL ({name})"
