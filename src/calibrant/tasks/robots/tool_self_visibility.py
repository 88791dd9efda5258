"""Find a hand camera on the gripper it sees, from one photo of the gripper on a board."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.words import pixels
from calibrant.tasks.outcome import Outcome

if TYPE_CHECKING:
    from calibrant.calibrate.tool.self_visibility import SelfVisibility
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult, Check, TransformEstimate

EXAMPLE = (
    'cb.tool_self_visibility(image="photo.png", features="features.csv", camera="camera.json", '
    'target="chessboard:9x6:25mm")'
)
LARGE_MM, LARGE_DEG = 2.0, 1.0
"""A hand camera is not known well enough to grasp with when it is known worse than this."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Where a hand camera sits, from one photo: the robot does not move.

    calibrant tool self-visibility --image photo.png --features features.csv --camera camera.json \\
        --target chessboard:9x6:25mm
    """

    image: Annotated[Path, Option("FILE")]
    """A photo by the hand camera of the board with the gripper flat on it."""
    features: Annotated[Path, Option("FILE.csv")]
    """Two or more gripper features: u, v in the photo, x_mm, y_mm, z_mm in the gripper (z 0 on the board)."""
    camera: Annotated[Path, Option("FILE")]
    """The hand camera (any format)."""
    target: Annotated[str | None, Option("SPEC", "-t")] = None
    """The board: chessboard:9x6:25mm (inner corners), charuco:5x7:36mm:18mm:DICT_6X6_250 (squares), or a file."""
    sigma_px: Annotated[str, Option("LENGTH")] = "0.5px"
    """Noise of a feature."""


def reads(request: Request) -> list[Path]:
    """The photo, the features and the camera."""
    return [request.image, request.features, request.camera]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The camera in the gripper. Raises: InputError; RefusedError as `calibrate_self_visibility`."""
    from calibrant.calibrate.pose.target_poses import target_poses
    from calibrant.calibrate.tool.self_visibility import calibrate_self_visibility, moved_by_camera
    from calibrant.data.verdicts import refuse_if_failed
    from calibrant.formats.cameras.read import read_camera
    from calibrant.tasks.inputs.columns import read_columns

    noise = pixels(request.sigma_px, option="--sigma-px") or 0.0
    if request.target is None:
        raise InputError("the photo needs the board it shows: --target, such as chessboard:9x6:25mm")
    table = read_columns(request.features, ("u", "v", "x_mm", "y_mm", "z_mm"))
    observations = session.detect_boards(
        [request.image], request.target, mirror_x=False, workers=None, cache="none", listener=listener
    )
    if not observations.views:
        raise InputError(
            f"{request.image}: {observations.missed[0].reason if observations.missed else 'no board found'}"
        )
    view = observations.views[0]
    camera = read_camera(request.camera, image_size=next(iter(observations.image_sizes.values())))
    found = target_poses(camera, [view])
    # 2n residuals and 6 unknowns of the pose; rms is per point over both axes.
    spare = max(2 * len(view) - 6, 1)
    variance = float(found.rms_px[0] ** 2) * len(view) / spare
    answer = calibrate_self_visibility(
        camera, found.T_camera_target[0], table.values[:, :2], 1e-3 * table.values[:, 2:],
        sigma_px=noise, covariance_target=variance * found.covariance[0],
        target_by_camera=moved_by_camera(camera, view, found.T_camera_target[0]),
    )  # fmt: skip
    result = _self_visibility_result(answer, camera, len(table.values), request, noise)
    refuse_if_failed(result)
    return Outcome(result=result)


def _self_visibility_result(
    answer: SelfVisibility, camera: Camera, features: int, request: Request, noise: float
) -> CalibrationResult:
    from calibrant.data import CalibrationResult, Check, verdict_of
    from calibrant.data.verdicts import stamp

    text = (
        f"the gripper's features lie {answer.misfit_mm:.3g} mm from where they should on the board; "
        f"{answer.sigma_misfit_mm:.3g} mm is explained by the noise, {noise:g} px a feature (--sigma-px)"
    )
    checks = (Check("features", "ok", text, answer.misfit_mm), _certainty(answer.gripper_camera, features))
    return stamp(
        CalibrationResult(
            "self-visibility", verdict_of(checks), checks, cameras={"camera": camera},
            transforms=(answer.gripper_camera,), inputs=session.file_records(reads(request)),
            options={"target": request.target, "sigma_px": noise},
        )
    )  # fmt: skip


def _certainty(found: TransformEstimate, features: int) -> Check:
    from calibrant.data import Check

    turns, shifts = found.sigma_rotation_deg, found.sigma_translation_mm
    deg, mm = (0.0 if s is None else float(s.max()) for s in (turns, shifts))
    text = f"the camera is known to {mm:.2g} mm and {deg:.2g} deg in the gripper (1 sigma, worst axis)"
    if mm < LARGE_MM and deg < LARGE_DEG:
        return Check("certainty", "ok", text, mm)
    more = "more features" if features > 2 else "more features than two"
    text += f"; features farther apart, {more}, or pixels located better (--sigma-px) would lower that"
    return Check("certainty", "warn", text, mm)
