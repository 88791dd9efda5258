"""What `calibrant dynamic` does: read the wrist's calibration and the photos, take the views in one by one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calibrant.cli import session
from calibrant.errors import InputError
from calibrant.tasks.inputs.pose_choice import PoseForm, best_reading
from calibrant.tasks.inputs.robot_choice import RobotChoice

if TYPE_CHECKING:
    from calibrant.calibrate.dynamic.problem import WristCamera
    from calibrant.calibrate.dynamic.track import DynamicCalibration, DynamicNoise
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult, Observations, View
    from calibrant.formats.poses.read import PoseNotation

PLACEMENTS = ("still", "moves")
NO_FIT = 10.0
"""Times their noise that the residuals may be: what is off by more are photos of another camera, pose or place."""


@dataclass(frozen=True)
class Request:
    """The command's arguments, as given."""

    wrist: Path
    camera: Path
    wrist_images: tuple[str, ...]
    external_images: tuple[str, ...]
    poses: tuple[str, ...]
    target: str | None
    target_stands: str
    sigma_px: float | None
    form: PoseForm
    arm: RobotChoice
    quiet: bool


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
        return float("inf") if solution is None else float(np.sqrt(2 * solution.cost / max(numbers, 1)))


def calibrate(request: Request) -> CalibrationResult:
    """Run the whole command. Raises: InputError, RefusedError as the parts do."""
    from calibrant.formats.cameras.read import read_camera
    from calibrant.formats.poses.pairing import match_raw

    if request.target_stands not in PLACEMENTS:
        raise InputError(f"--target-stands {request.target_stands}: choose {' or '.join(PLACEMENTS)}")
    if request.target is None:
        raise InputError("photos need the board they show: --target, such as chessboard:9x6:25mm")
    wrist, noise = wrist_of(request.wrist, request.sigma_px)
    raw = request.form.read(request.poses, request.arm)
    near = _boards(request, request.wrist_images, "wrist")
    far = _boards(request, request.external_images, "external")
    if request.target_stands == "moves" and len(near.views) != len(far.views):
        raise InputError(
            f"{len(near.views)} photos of the wrist camera and {len(far.views)} of the external one show the board; "
            "where the target moves, the n-th photos of both belong together: leave out those without a partner"
        )
    size = next(iter(far.image_sizes.values()))
    external = read_camera(request.camera, image_size=size)
    pairing = match_raw(raw, [v.id for v in near.views])
    session.load_solver(quiet=request.quiet)

    def attempt(reading: PoseNotation) -> Taken:
        T = reading.T_base_gripper[list(pairing.pose_index)]
        views = [near.views[i] for i in pairing.view_index]
        return take_in(wrist, external, noise, views, T, far.views, moves=request.target_stands == "moves")

    chosen = best_reading(
        raw, attempt, lambda t: t.known.solution.cost if t.known.solution else float("inf"),
        fits=lambda t: t.off < NO_FIT, what=(
            f"the photos do not fit together: whatever way the poses are read, they are more than {NO_FIT:.0f} times "
            "their noise apart; check that each option has the photos of its own camera, that the poses are those of "
            "the wrist's photos, and that the target did not move (--target-stands moves)"
        ),
    )  # fmt: skip
    files: list[str | Path] = [request.wrist, request.camera, *request.poses, *request.arm.files]
    return _result(chosen.outcome, external, chosen.reading.description, pairing.message, files)


def wrist_of(path: Path, sigma_px: float | None) -> tuple[WristCamera, DynamicNoise]:
    """The wrist camera with its joint covariance, and the noise, from a hand-eye result.

    Raises: InputError for a result that is not of a camera on the gripper, or was not made from images.
    """
    from calibrant.calibrate.dynamic.problem import WristCamera
    from calibrant.calibrate.dynamic.track import DynamicNoise
    from calibrant.data.result_file import read_result
    from calibrant.diagnose.budget.single import error_budget

    budget = error_budget(read_result(path))
    if budget.setup.camera_parent != "gripper" or budget.camera is None or budget.noise is None:
        raise InputError(f"{path}: expected the hand-eye result of a camera on the gripper, made from images")
    rows = np.r_[0:6, 12 : 12 + len(budget.camera.values)]
    covariance = budget.covariance[np.ix_(rows, rows)]
    n = budget.noise
    noise = DynamicNoise(n.pixel, sigma_px or n.pixel, n.robot_rotation, n.robot_translation)
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
        known = noted((known.target_moved() if moves else known).seen_by_wrist(view, T))
        if moves:
            known = noted(known.seen_by_external(far[i]))
    for view in () if moves else far:
        known = noted(known.seen_by_external(view))
    return Taken(known, tuple(surprises))


def _boards(request: Request, images: Sequence[str], camera: str) -> Observations:
    from calibrant.detection.images.images import expand

    files = expand(list(images))
    found = session.detect_boards(
        files, request.target or "", mirror_x=False, workers=None, quiet=request.quiet, camera=camera
    )
    if not found.views:
        raise InputError(f"no photo of the {camera} camera shows the board; the first: {found.missed[0].reason}")
    return found


def _result(
    taken: Taken, external: Camera, reading: str, pairing: str, files: Sequence[str | Path]
) -> CalibrationResult:
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
    checks += [Check("pose-reading", "ok", reading), Check("pairing", "ok", pairing)]
    shares = {f"variance by {source}": Measured(round(share, 4)) for source, share in known.shares.items()}
    return stamp(
        CalibrationResult(
            "dynamic", verdict_of(tuple(checks)), tuple(checks), cameras={"external": known.camera},
            transforms=(estimate,), figures=shares,
            decided={"pose_reading": reading}, inputs=session.file_records(files),
        )
    )  # fmt: skip
