"""The calibration of repaired data, with the uncertainty that the repair itself brings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.calibrate.solvers.registry import JOINT
from calibrant.data import CalibrationResult, Measured, TransformEstimate
from calibrant.diagnose.doctor.diagnosis import Diagnosis
from calibrant.diagnose.doctor.evidence.case import Case
from calibrant.diagnose.doctor.faults import size
from calibrant.diagnose.doctor.sized import FREED
from calibrant.errors import RefusedError, causes


def calibrate_repaired(diagnosis: Diagnosis, *, model: str = "brown", fix: Sequence[str] = ()) -> CalibrationResult:
    """Hand-eye calibration of the data with every repair applied.

    Where the target's size was estimated, its uncertainty is added: C + J J^T sigma_s^2, J = dX / ds.
    Raises: RefusedError for a fault that only a person can cure, and as `calibrate_hand_eye`.
    """
    left = [f for f in diagnosis.findings if f.status == "fail" and not f.proposal]
    if left:
        raise RefusedError(causes(f"{f.name}: {f.message}" for f in left))
    case = diagnosis.repaired
    result = _calibrated(case, diagnosis, model, fix, JOINT)
    names = ("target-size", FREED)
    estimated = next((f.measured for n in names for f in diagnosis.named(n) if f.measured is not None), None)
    return result if estimated is None else _with_size(result, case, estimated)


def calibrate_freed(
    diagnosis: Diagnosis, *, model: str = "brown", fix: Sequence[str] = (), method: str = JOINT
) -> CalibrationResult:
    """Hand-eye calibration of the data as they are but for the target's size, which the robot's motion says.

    The uncertainty of that size is added, as in `calibrate_repaired`. Raises: RefusedError as `calibrate_hand_eye`.
    """
    case = diagnosis.examination.case
    estimated = next(f.measured for f in diagnosis.named(FREED) if f.measured is not None)
    result = _calibrated(case, diagnosis, model, fix, method)
    return _with_size(replace(result, target_scale=estimated), case, estimated)


def _calibrated(case: Case, diagnosis: Diagnosis, model: str, fix: Sequence[str], method: str) -> CalibrationResult:
    camera = case.camera if case.camera_given else None
    return calibrate_hand_eye(
        case.poses,
        case.target(),
        setup=diagnosis.poses.setup,
        camera=camera,
        model=model,
        fix=fix,
        method=method,
    )


def _with_size(result: CalibrationResult, case: Case, estimated: Measured) -> CalibrationResult:
    """The transforms with what the target's size leaves uncertain."""
    changes = size.sensitivity(case)
    transforms = tuple(_widened(t, d * estimated.sigma / estimated.value) for t, d in zip(result.transforms, changes))
    return replace(result, transforms=transforms)


def _widened(transform: TransformEstimate, change: np.ndarray) -> TransformEstimate:
    if transform.covariance is None:
        return transform
    return replace(transform, covariance=transform.covariance + np.outer(change, change))
