"""Views of the wrist camera and of one beside the robot, taken in one by one, and the result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.cancel import checkpoint
from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import Listener
from calibrant.tasks.robots.dynamic_request import Request, reads

if TYPE_CHECKING:
    import numpy as np

    from calibrant.calibrate.dynamic.problem import WristCamera
    from calibrant.calibrate.dynamic.track import DynamicCalibration, DynamicNoise
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult, Observations, View


LEAST_SPARE = 30
"""Numbers that tell a noise level to 13 %."""
COARSE_PX = 1.0
"""Corners are found to some tenths of a pixel where the lens is known: beyond a pixel the lens is another."""
NO_FIT = 10.0
"""Times their noise that the residuals may be: what is off by more are photos of another camera, pose or place."""
DO_NOT_FIT = (
    f"the photos do not fit together: whatever way the poses are read, they are more than {NO_FIT:.0f} times their "
    "noise apart; check that each option has the photos of its own camera, that the poses are those of the wrist's "
    "photos, and that the target did not move (--target-stands moves)"
)


@dataclass(frozen=True, eq=False)
class Taken:
    """The estimate after all views, and the ids of the views that surprised it."""

    known: DynamicCalibration
    surprises: tuple[str, ...]

    @property
    def off(self) -> float:
        """The residuals' root mean square over their noise."""
        solution = self.known.solution
        numbers = sum(2 * len(sight.view) for sight in self.known.sights)
        return float("inf") if solution is None else sqrt(2 * solution.cost / max(numbers, 1))


def own_noise(camera: Camera, views: Sequence[View]) -> float | None:
    """Pixels per axis that the views of a camera leave, each at its own pose; None where they are too few points.

    Another lens, another distance and another light than the wrist camera's: its noise says nothing of this one's.
    """
    import numpy as np

    from calibrant.calibrate.pose.target_poses import target_poses

    spare = sum(2 * len(v) - 6 for v in views)
    if spare < LEAST_SPARE:
        return None
    found = target_poses(camera, views)
    counts = np.array([len(v) for v in views])
    return float(np.sqrt(np.sum(counts * found.rms_px**2) / spare))


def wrist_of(path: Path) -> tuple[WristCamera, DynamicNoise]:
    """From a file: `wrist_from`."""
    from calibrant.data.result_file import read_result

    return wrist_from(read_result(path), str(path))


def wrist_from(known: CalibrationResult, name: str) -> tuple[WristCamera, DynamicNoise]:
    """The wrist camera with its joint covariance, and the noise, from a hand-eye result.

    Raises: InputError for a result that is not of a camera on the gripper, or was not made from images.
    """
    import numpy as np

    from calibrant.calibrate.dynamic.problem import WristCamera
    from calibrant.calibrate.dynamic.track import DynamicNoise
    from calibrant.diagnose.budget.cell import error_budget

    budget = error_budget(known)
    if budget.setup.camera_parent != "gripper" or budget.camera is None or budget.noise is None:
        raise InputError(f"{name}: expected the hand-eye result of a camera on the gripper, made from images")
    rows = np.r_[0:6, 12 : 12 + len(budget.camera.values)]
    covariance = budget.covariance[np.ix_(rows, rows)]
    n = budget.noise
    noise = DynamicNoise(n.pixel, n.pixel, n.robot_rotation, n.robot_translation)
    return WristCamera(budget.camera, budget.X, covariance), noise


def take_in(
    wrist: WristCamera,
    external: Camera,
    noise: DynamicNoise,
    near: Sequence[View],
    T_base_gripper: np.ndarray,
    far: Sequence[View],
    *,
    moves: bool,
) -> Taken:
    """All views, one by one: in pairs where the target moves, else the wrist camera's first."""
    from calibrant.calibrate.dynamic.track import DynamicCalibration

    known, surprises = DynamicCalibration(wrist, external, noise), []

    def noted(after: DynamicCalibration) -> DynamicCalibration:
        if after.last is not None and after.last.surprising:
            surprises.append(after.last.view)
        return after

    for i, (view, T) in enumerate(zip(near, T_base_gripper)):
        checkpoint()
        known = noted((known.target_moved() if moves else known).seen_by_wrist(view, T))
        if moves:
            known = noted(known.seen_by_external(far[i]))
    for view in () if moves else far:
        checkpoint()
        known = noted(known.seen_by_external(view))
    return Taken(known, tuple(surprises))


def boards(request: Request, images: Sequence[str], camera: str, listener: Listener) -> Observations:
    from calibrant.detection.images.files import expand

    files = expand(list(images))
    found = session.detect_boards(
        files, request.target or "", mirror_x=False, workers=None, camera=camera, listener=listener
    )
    if not found.views:
        raise InputError(f"no photo of the {camera} camera shows the board; the first: {found.missed[0].reason}")
    return found


def dynamic_result(
    taken: Taken, request: Request, reading: str, pairing: str, noise: DynamicNoise
) -> CalibrationResult:
    import numpy as np

    from calibrant.data import CalibrationResult, Check, Measured, verdict_of
    from calibrant.data.verdicts import stamp
    from calibrant.diagnose.budget.workspace import budget_words, sigma_mm

    known, estimate = taken.known, taken.known.T_base_external
    covariance = np.asarray(estimate.covariance)
    text = (
        f"the external camera is known to {float(sigma_mm(covariance[3:, 3:])):.3g} mm and "
        f"{float(np.rad2deg(1e-3 * sigma_mm(covariance[:3, :3]))):.2g} deg (1 sigma, worst direction). "
        f"{budget_words(known.shares)}"
    )
    checks = [Check("certainty", "ok", text, float(sigma_mm(covariance[3:, 3:])))]
    if taken.surprises:
        words = f"{', '.join(taken.surprises)}: at odds with the views before; did the target or a camera move?"
        checks.append(Check("consistency", "warn", words, float(len(taken.surprises))))
    else:
        checks.append(Check("consistency", "ok", f"{len(known.sights)} views agree within their noise", 0.0))
    levels = f"noise of a corner: {noise.wrist_px:.2g} px (wrist), {noise.external_px:.2g} px (external)"
    coarse = noise.external_px > COARSE_PX
    levels += "; is the external camera's file that of the camera that took them?" if coarse else ""
    checks.append(Check("noise", "warn" if coarse else "ok", levels, noise.external_px))
    checks += [Check("pose-reading", "ok", reading), Check("pairing", "ok", pairing)]
    shares = {f"variance by {source}": Measured(round(share, 4)) for source, share in known.shares.items()}
    return stamp(
        CalibrationResult(
            "dynamic", verdict_of(tuple(checks)), tuple(checks), cameras={"external": known.camera},
            transforms=(estimate,), figures=shares,
            decided={"pose_reading": reading}, inputs=session.file_records(reads(request)),
            options={"target": request.target, "target_stands": request.target_stands},
        )
    )  # fmt: skip
