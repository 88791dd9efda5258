"""The cameras of a simulated cell, calibrated from its pictures: as near to the truth as the result says."""

from __future__ import annotations

import numpy as np
import pytest
from tests.simulate.robot_cell.cells import needs_opengl

from calibrant.geometry import se3

from calibrant.simulate.robot_cell import make_robot_cell  # isort: skip
from calibrant.studies.cell_calibration import calibrate_cell_cameras  # isort: skip


@needs_opengl()
@pytest.mark.long
@pytest.mark.parametrize("view", ["wrist", "front", "top"])
def test_a_view_is_calibrated_to_its_stated_accuracy(view: str) -> None:
    with make_robot_cell(100) as cell:
        found = calibrate_cell_cameras(cell, (view,))[view].hand_eye
        wrist = view == "wrist"
        T = found.transform("gripper" if wrist else "base", view)
        true = cell.truth.T_gripper_camera(view) if wrist else cell.truth.T_base_camera(view)
        off = se3.local(true, T.matrix)
        assert T.covariance is not None
        # Six numbers: chi-squared beyond 22.5 comes once in a thousand.
        assert off @ np.linalg.solve(T.covariance, off) < 22.5
        assert np.linalg.norm(off[3:]) < 2e-3
        true_f, f = cell.truth.camera(view).parameters["fx"], found.cameras[view].parameters["fx"]
        assert abs(f - true_f) < 5 * found.cameras[view].sigma["fx"]
        # Things are back where they lay, the arm is at rest.
        assert cell.present("red cube")
        np.testing.assert_allclose(cell.robot.joints(), cell.robot.home, atol=1e-4)
