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
    from calibrant.calibrate.one_point.solve import OnePoint, Setup
    from calibrant.data import CalibrationResult, Check
    from calibrant.formats.poses.read import PoseNotation

EXAMPLE = 'cb.hand_eye_point(poses="poses.csv", points="points.csv", setup="eye-to-hand")'
SETUPS = ("eye-to-hand", "eye-in-hand")
NO_PLACE = (
    "no reading of the poses puts the camera where the points are; do poses and points belong to one session, and is "
    "the setup right?"
)
NOT_A_POINT = 0.05
"""Of the distance: no depth camera errs by a twentieth of it, poses or points of another session do."""
LARGE = 0.02
"""What makers of stereo depth cameras state at most."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Find where a camera is, from one point that a depth camera sees at six poses or more.

    calibrant hand-eye-point --poses poses.csv --points points.csv --setup eye-to-hand

    Camera beside the robot: a point of the gripper. Camera on the gripper: a point that stands still. Turn the gripper
    about two axes, and move the point through space. Noise and scale of the depth are found, too.
    """

    poses: Annotated[tuple[str, ...], Option("FILES")]
    """File of robot poses, or one file a pose."""
    points: Annotated[Path, Option("FILE.csv")]
    """Where the camera sees the point at each pose: columns image, x, y, z in metres, camera's frame."""
    setup: Annotated[str, Option("NAME", choices=SETUPS)] = "eye-to-hand"
    """eye-to-hand: the camera stands beside the robot; eye-in-hand: it is on the gripper."""
    sigma_scale: Annotated[str, Option("PERCENT")] = "2%"
    """1 sigma of a factor that all depths share, before the robot's motion tells it; 0% where it is exact."""
    arm: RobotOptions = RobotOptions()
    form: TouchPoseOptions = TouchPoseOptions()


def reads(request: Request) -> list[str | Path]:
    """The poses, the points, and the robot's file."""
    return [*request.poses, request.points, *request.arm.files]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The camera's place. Raises: InputError; RefusedError as `calibrate_one_point`."""
    import numpy as np

    from calibrant.calibrate.one_point.solve import calibrate_one_point
    from calibrant.data import RobotPoses
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
    if np.median(points[:, 2]) > 100:
        raise InputError(f"the points are {np.median(points[:, 2]):g} m away; are they millimetres? Expected metres")
    far, share = float(np.median(np.linalg.norm(points, axis=1))), _percent(request.sigma_scale)
    session.load_pose_solver(listener)

    def attempt(reading: PoseNotation) -> OnePoint:
        paired = reading.take(list(pairing.pose_index), [names[v] for v in pairing.view_index])
        setup: Setup = "eye-to-hand" if request.setup == "eye-to-hand" else "eye-in-hand"
        return calibrate_one_point(
            RobotPoses(paired.ids, paired.T_base_gripper), points, setup=setup, scale_sigma=share
        )

    with listener.status("Finding the camera …"):
        chosen = best_reading(
            raw, attempt, lambda f: f.rms_mm, fits=lambda f: f.rms_mm < 1e3 * NOT_A_POINT * far, what=NO_PLACE
        )
    result = _result(request, chosen.outcome, chosen.reading)
    refuse_if_failed(result)
    return Outcome(result=result)


def _percent(text: str) -> float:
    try:
        value = float(text.strip().removesuffix("%")) / 100
    except ValueError:
        value = -1.0
    if not text.strip().endswith("%") or not 0 <= value < 1:
        raise InputError(f"--sigma-scale takes per cent, such as 0.5%; got {text!r}")
    return value


def _result(request: Request, found: OnePoint, reading: PoseNotation) -> CalibrationResult:
    import numpy as np

    from calibrant.data import CalibrationResult, Measured, ViewResult
    from calibrant.data.results import verdict_of
    from calibrant.data.verdicts import stamp

    checks = _checks(found)
    other = "gripper" if request.setup == "eye-to-hand" else "base"
    off = 1e3 * np.linalg.norm(found.residuals, axis=1)
    figures = {
        f"point_{axis}_in_{other}": Measured(1e3 * float(v), float(s), "mm")
        for axis, v, s in zip("xyz", found.point, found.point_sigma_mm)
    }
    figures["depth_scale"] = Measured(100 * found.scale, 100 * found.scale_sigma, "%")
    figures["rms_mm"] = Measured(found.rms_mm, unit="mm")
    return stamp(
        CalibrationResult(
            "hand-eye-point",
            verdict_of(checks),
            checks=checks,
            transforms=(found.transform,),
            views=tuple(
                ViewResult(n, bool(u), 1, reason=f"{o:.2f} mm off" + ("" if u else ", at odds with the others"))
                for n, o, u in zip(found.ids, off.tolist(), found.used)
            ),
            figures=figures,
            decided={"poses": reading.description},
            options={"setup": request.setup, "sigma_scale": request.sigma_scale},
            inputs=session.file_records(reads(request)),
        )
    )


def _checks(found: OnePoint) -> tuple[Check, ...]:
    from calibrant.data import Check

    text = f"the poses agree on the point to {found.rms_mm:.2g} mm rms"
    if found.sigma_along is not None and found.sigma_across is not None:
        text += (
            f"; at 1 m a point scatters by {1e3 * found.sigma_along:.2g} mm along the sight and "
            f"{1e3 * found.sigma_across:.2g} mm across it (1 sigma, robot included)"
        )
    out = [Check("noise", "ok", text, found.rms_mm)]
    lost = [name for name, used in zip(found.ids, found.used) if not used]
    if lost:
        words = (
            f"{len(lost)} of {len(found.ids)} poses are at odds with the others and set aside: {', '.join(lost[:5])}"
        )
        out.append(Check("outliers", "warn", words, float(len(lost))))
    long = "long" if found.scale > 0 else "short"
    words = f"depths are {100 * abs(found.scale):.2f} ± {100 * found.scale_sigma:.2f} % (1 sigma) too {long}"
    if found.scale_sigma > 0:
        off = abs(found.scale) > max(3 * found.scale_sigma, LARGE)
        out.append(Check("scale", "warn" if off else "ok", words + ("; the robot's motion says so" * off), found.scale))
    return tuple(out)
