"""A window on the running cell: MuJoCo's own viewer, where there is a screen."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

from calibrant.errors import InputError
from calibrant.simulate.robot_cell.world.engine import need_mujoco

if TYPE_CHECKING:
    from calibrant.simulate.robot_cell.world.physics import World

_PICTURES_A_SECOND = 30


def open_window(world: World) -> Callable[[float], None]:
    """Opens the viewer; what it gives back is called after every step and keeps the window up to date.

    Raises: InputError where there is no screen.
    """
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError("there is no screen to show the cell on (DISPLAY is not set); use --record DIR for a film")
    need_mujoco()
    from mujoco import viewer

    window = viewer.launch_passive(world.model, world.data, show_left_ui=False, show_right_ui=False)
    shown = [-1.0]

    def follow(time_s: float) -> None:
        if window.is_running() and time_s >= shown[0] + 1 / _PICTURES_A_SECOND:
            shown[0] = time_s
            window.sync()

    return follow
