"""`servo run` with devices: a cell opened by a spec is led to what was taught in it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.devices import simulated_cell
from calibrant.devices.driver import Opened
from calibrant.devices.spec import DeviceSpec
from calibrant.errors import InputError, RefusedError
from calibrant.opencv import cv2


def test_devices_and_target_go_together(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="robot_device and camera_device"):
        cb.servo_run()
    with pytest.raises(InputError, match="robot_device and camera_device"):
        cb.servo_run(robot_device="cell", camera_device="cell")
    with pytest.raises(InputError, match="simulated cells"):
        cb.servo_run(tmp_path / "target.json", robot_device="cell", camera_device="cell", focal_error="5%")


@pytest.mark.long
def test_cell_by_its_spec_is_led_to_what_was_taught_in_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mujoco", reason="the cell is MuJoCo's: pip install 'calibrant[sim]'")
    from calibrant.simulate.robot_cell import make_robot_cell
    from calibrant.studies.cell_calibration import calibrate_cell_cameras
    from calibrant.tasks.verify.in_cell.pinpoint import over

    with make_robot_cell(0) as cell:
        known = calibrate_cell_cameras(cell, ("wrist",))["wrist"].hand_eye
        target = cell.objects["marker"].target
    hand_eye = known.transforms[0].matrix
    known.write(tmp_path / "hand-eye.json")
    with make_robot_cell(0) as cell:
        place = cell.truth.T_base_object("marker")[:3, 3]
        cell.robot.move_to(over(hand_eye, np.add(place, [0, 0, 0.3]), cell.robot.pose()))
        for k in range(6):
            cv2.imwrite(str(tmp_path / f"wanted{k}.png"), cell.cameras["wrist"].take().colour)
        wanted = cell.robot.pose()
    taught = cb.servo_teach(tmp_path / "hand-eye.json", images=str(tmp_path / "wanted*.png"), target=target)
    taught.write(tmp_path / "target.json")

    def led_to_where_it_sees(spec: DeviceSpec) -> Opened:
        opened = open_cell(spec)
        assert opened.robot is not None
        opened.robot.move_to(over(hand_eye, np.add(place, [0.06, -0.05, 0.42]), opened.robot.pose()))
        return opened

    open_cell = simulated_cell.open_cell
    monkeypatch.setattr(simulated_cell, "DRIVER", replace(simulated_cell.DRIVER, connect=led_to_where_it_sees))
    devices = {"robot_device": "cell:seed=0", "camera_device": "cell"}
    result = cb.servo_run(tmp_path / "target.json", **devices, tolerance="2mm", tolerance_turn="1deg")
    assert result.kind == "servo"
    assert result.check("arrived").status == "ok"
    assert np.linalg.norm(result.transforms[0].matrix[:3, 3] - wanted[:3, 3]) < 2e-3
    with pytest.raises(InputError, match="kind 'hand-eye'"):
        cb.servo_run(tmp_path / "hand-eye.json", **devices)
    with pytest.raises(RefusedError, match="tolerance cannot be met"):
        cb.servo_run(tmp_path / "target.json", **devices, tolerance="0.001mm")
