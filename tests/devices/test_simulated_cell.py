"""The simulated cell opened by a spec."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.devices import open_devices
from calibrant.errors import DeviceError, InputError

pytest.importorskip("mujoco", reason="the cell is MuJoCo's: pip install 'calibrant[sim]'")


@pytest.mark.long
def test_robot_and_camera_are_of_one_cell() -> None:
    """The wrist camera sees something else once the arm has moved, and time is the cell's."""
    with open_devices(robot="cell:seed=3,arm=ur5e", camera="cell") as devices:
        robot, camera = devices.robot, devices.camera
        assert camera.name == "wrist"
        assert len(robot.joints()) == 6
        before = camera.take()
        assert before.depth is not None
        T = robot.pose()
        T[2, 3] += 0.05
        robot.move_to(T)
        after = camera.take()
        assert after.time_s > before.time_s
        assert np.abs(after.colour.astype(float) - before.colour).mean() > 3
    with pytest.raises(DeviceError, match="closed"):
        camera.take()


def test_what_a_cell_cannot_be() -> None:
    with pytest.raises(InputError, match="a whole number, got 'x'"):
        open_devices(robot="cell:seed=x")
    with pytest.raises(InputError, match="takes options alone"):
        open_devices(robot="cell:3")
    with pytest.raises(InputError, match="seed=3 and seed=4"):
        open_devices(robot="cell:seed=3", camera="cell:seed=4,camera=top")
