"""Find where a depth camera is, from one point that it sees while the robot moves."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.poses import TouchPoseOptions
from calibrant.tasks.options.robots import RobotOptions
from calibrant.tasks.outcome import Outcome

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from calibrant.calibrate.one_point.hand_eye import OnePointHandEye
    from calibrant.data import CalibrationResult, Check
    from calibrant.formats.poses.read import PoseNotation

EXAMPLE = 'cb.hand_eye_point(poses="poses.csv", points="points.csv", setup="eye-to-hand")'
SETUPS = ("eye-to-hand", "eye-in-hand")
NO_PLACE = (
    "no reading of the poses puts the camera where the points are; do poses and points belong to one session, and is "
    "the setup right?"
)
NOT_A_POINT = 10.0
"""Times the stated noise: residuals of poses or points of another session."""
_LATERAL_PX, _FOCAL_PX = 0.5, 600.0
"""Of a found point in the picture, and a usual focal length at 640 pixels: 0.4 mm at half a metre."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Find where a camera is, from one point that a depth camera sees at four poses or more.

    calibrant hand-eye-point --poses poses.csv --points points.csv --setup eye-to-hand

    Camera beside the robot: a point of the gripper. Camera on the gripper: a point that stands still. Turn the gripper
    about two axes, and move the point through space.
    """

    poses: Annotated[tuple[str, ...], Option("FILES")]
    """File of robot poses, or one file a pose."""
    points: Annotated[Path, Option("FILE.csv")]
    """Where the camera sees the point at each pose: columns image, x, y, z in metres, camera's frame."""
    setup: Annotated[str, Option("NAME", choices=SETUPS)] = "eye-to-hand"
    """eye-to-hand: the camera stands beside the robot; eye-in-hand: it is on the gripper."""
    baseline: Annotated[str, Option("LENGTH")] = "50mm"
    """Of the depth camera, by which its noise grows with distance: D435 50mm, D455 95mm."""
    arm: RobotOptions = RobotOptions()
    form: TouchPoseOptions = TouchPoseOptions()


def reads(request: Request) -> list[str | Path]:
    """The poses, the points, and the robot's file."""
    return [*request.poses, request.points, *request.arm.files]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The camera's place. Raises: InputError; RefusedError as `hand_eye_of_point`."""
    from calibrant.calibrate.one_point.hand_eye import hand_eye_of_point
    from calibrant.data.verdicts import refuse_if_failed
    from calibrant.formats.poses.pairing import match_by_order, match_raw
    from calibrant.tasks.inputs.columns import read_columns
    from calibrant.tasks.inputs.pose_choice import best_reading

    if request.setup not in SETUPS:
        raise InputError(f"--setup is {' or '.join(SETUPS)}, got {request.setup!r}")
    table = read_columns(request.points, ("x", "y", "z"))
    names = table.names or tuple(str(i) for i in range(len(table.values)))
    raw = request.form.read(request.poses, request.arm)
    pairing = match_by_order(len(raw), names) if table.names is None else match_raw(raw, names)
    points = table.values[list(pairing.view_index)]
    spread = _noise(points, request.baseline)
    session.load_pose_solver(listener)

    def attempt(reading: PoseNotation) -> OnePointHandEye:
        paired = reading.take(list(pairing.pose_index), [names[v] for v in pairing.view_index])
        return hand_eye_of_point(paired.T_base_gripper, points, setup=request.setup, covariances=spread)

    chosen = best_reading(
        raw, attempt, lambda found: found.noise_ratio, fits=lambda f: f.noise_ratio < NOT_A_POINT, what=NO_PLACE
    )
    paired_names = [names[v] for v in pairing.view_index]
    result = _result(request, chosen.outcome, chosen.reading, paired_names)
    refuse_if_failed(result)
    return Outcome(result=result)


def _noise(points: NDArray[np.float64], baseline: str) -> NDArray[np.float64]:
    """Covariances (n, 3, 3) of the points: depth's noise along the ray, half a pixel across it."""
    import numpy as np

    from calibrant.perceive.registered_depth.noise import DepthNoise
    from calibrant.targets.lengths import parse_length

    z = points[:, 2]
    if np.any(z <= 0):
        behind = f"point {int(np.argmin(z))} is behind the camera (z = {z.min():g} m)"
        raise InputError(f"{behind}; expected x right, y down, z forward, in metres")
    if np.median(z) > 100:
        raise InputError(f"the points are {np.median(z):g} m away; are they millimetres? Expected metres")
    noise = DepthNoise.stereo(focal_px=_FOCAL_PX, baseline_m=parse_length(baseline, what="--baseline"))
    along = np.hypot(noise.sigma_z(z), noise.offset_sigma * z * z)
    ray = points / z[:, None]
    across = (_LATERAL_PX * z / _FOCAL_PX) ** 2
    return across[:, None, None] * np.eye(3) + (along**2)[:, None, None] * ray[:, :, None] * ray[:, None, :]


def _result(request: Request, found: OnePointHandEye, reading: PoseNotation, names: list[str]) -> CalibrationResult:
    import numpy as np

    from calibrant.calibrate.one_point.hand_eye import widened
    from calibrant.data import CalibrationResult, Measured, TransformEstimate, ViewResult
    from calibrant.data.results import verdict_of
    from calibrant.data.verdicts import stamp

    checks = _checks(found)
    final = widened(found)
    parent, other = ("base", "gripper") if request.setup == "eye-to-hand" else ("gripper", "base")
    off = 1e3 * np.linalg.norm(found.residuals, axis=1)
    sigma = 1e3 * np.sqrt(np.diag(final.point_covariance))
    figures = {
        f"point_{axis}_in_{other}": Measured(1e3 * float(v), float(s), "mm")
        for axis, v, s in zip("xyz", final.point, sigma)
    }
    return stamp(
        CalibrationResult(
            "hand-eye-point",
            verdict_of(checks),
            checks=checks,
            transforms=(TransformEstimate(parent, "camera", final.T, final.covariance),),
            views=tuple(ViewResult(n, True, 1, reason=f"{o:.2f} mm off") for n, o in zip(names, off.tolist())),
            figures={**figures, "rms_mm": Measured(float(np.sqrt(np.mean(off**2))), unit="mm")},
            decided={"poses": reading.description},
            options={"setup": request.setup, "baseline": request.baseline},
            inputs=session.file_records(reads(request)),
        )
    )


def _checks(found: OnePointHandEye) -> tuple[Check, ...]:
    from calibrant.calibrate.one_point.hand_eye import SURPRISING
    from calibrant.data import Check

    ratio = found.noise_ratio
    if found.chance < SURPRISING:
        words = f"the points are {ratio:.1f} times as noisy as this depth camera makes them; sigmas are widened by that"
        return (Check("noise", "warn", words, ratio),)
    return (Check("noise", "ok", f"the points scatter as stated ({ratio:.2f} of it)", ratio),)
