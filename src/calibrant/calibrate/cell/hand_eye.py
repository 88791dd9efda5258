"""Hand-eye and robot-world calibration of one camera on one robot: a cell of one list of pictures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from calibrant.calibrate.cell.calibrate import Accuracy, accuracies_asked, fit_cell, judged_cell, told_accuracies
from calibrant.calibrate.cell.lens_choice import lenses_asked
from calibrant.calibrate.cell.methods import answered_by, normal_pairs
from calibrant.calibrate.cell.problem.layout import Pictures, TargetPoses
from calibrant.calibrate.solvers.registry import JOINT, require_method
from calibrant.calibrate.solvers.setup import get_setup
from calibrant.cameras import Camera
from calibrant.data import DEFAULT_CAMERA, CalibrationResult, Observations, RobotPoses


def calibrate_hand_eye(
    T_base_gripper: RobotPoses | ArrayLike,
    target: Observations | ArrayLike,
    *,
    setup: str,
    camera: Camera | None = None,
    model: str = "brown",
    fix: Sequence[str] = (),
    method: str = JOINT,
    robot_accuracy: Accuracy | None = None,
) -> CalibrationResult:
    """Calibrate where the camera is: on the gripper (eye-in-hand) or beside the robot (eye-to-hand).

    T_base_gripper: robot poses, RobotPoses or (n, 4, 4), metres. target: T_camera_target (n, 4, 4), or Observations of
    one camera whose views carry the poses' ids. camera: known intrinsics, with their covariance where it is known;
    without it the same images calibrate the camera (`model`, `fix`). method: "joint", the weighted refinement, or a
    closed form, whose transforms come without covariance (`solvers.registry.METHODS`). robot_accuracy: how far the
    flange is off, rms: metres, "0.3mm" or "0.3mm,0.02deg"; errors of the robot's geometry are then in every sigma.
    Returns a CalibrationResult of kind "hand-eye". Raises: InputError for unusable input; RefusedError when the poses
    cannot determine the result or contradict it, naming why.

    Example::

        result = cb.calibrate_hand_eye(T_base_gripper, T_camera_target, setup="eye-in-hand")
        result.transform("gripper", "camera").matrix
    """
    chosen = get_setup(setup)
    require_method(method)
    poses = T_base_gripper if isinstance(T_base_gripper, RobotPoses) else RobotPoses.from_matrices(T_base_gripper)
    seen: Observations | TargetPoses
    if isinstance(target, Observations):
        from calibrant.calibrate.cell.photos import named_by_poses  # not needed for pose pairs

        seen = named_by_poses(target, poses, given_ids=isinstance(T_base_gripper, RobotPoses))
        known = {} if camera is None else {DEFAULT_CAMERA: camera}
    else:
        seen, known = TargetPoses(poses.ids, np.asarray(target)), {}
    told = told_accuracies(robot_accuracy)
    pictures = [Pictures(DEFAULT_CAMERA, chosen.name, seen)]
    fit = fit_cell(poses, pictures, cameras=known, model=model, fix=fix, accuracies=told)
    result = judged_cell(fit, lenses_asked(fix) | accuracies_asked(told))
    return result if method == JOINT else answered_by(result, method, *normal_pairs(fit.cell, fit.noise.solution, 0))
