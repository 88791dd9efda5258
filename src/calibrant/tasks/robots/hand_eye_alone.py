"""The only list of hand-eye: one camera on or before one robot, by any method, from photos or target poses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from calibrant.errors import InputError
from calibrant.tasks.robots.hand_eye_pictures import ReadList

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult


def calibrated_alone(
    part: ReadList,
    *,
    model: str,
    fix: Sequence[str],
    method: str = "joint",
    accuracy: str | None = None,
    free_scale: bool = False,
) -> CalibrationResult:
    """The calibration of a list that is alone. accuracy: of the robot; free_scale: the target's size is found too.

    Raises: InputError, RefusedError as the calibration.
    """
    from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye

    data, diagnosis = part.data, part.diagnosis
    if data is None or diagnosis is None:
        raise InputError("a closed form needs a camera that moves against its target; leave --method out")
    if free_scale:
        from calibrant.diagnose.doctor.repair import calibrate_freed

        return calibrate_freed(diagnosis, model=model, fix=fix, method=method)
    target = data.T_camera_target if data.observations is None else diagnosis.numbered(data.observations)
    return calibrate_hand_eye(
        diagnosis.poses.notation.poses,
        target,  # type: ignore[arg-type]
        setup=diagnosis.poses.setup,
        camera=data.camera,
        model=model,
        fix=fix,
        method=method,
        robot_accuracy=accuracy,
    )
