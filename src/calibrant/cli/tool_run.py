"""What `calibrant tool` does: read, calibrate, and put it as a result."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibrant.cli import session
from calibrant.cli.pose_choice import PoseForm, best_reading
from calibrant.cli.robot_choice import RobotChoice
from calibrant.errors import InputError

if TYPE_CHECKING:
    from calibrant.calibrate.tool import ToolTip
    from calibrant.data import CalibrationResult, RobotPoses
    from calibrant.formats.poses import PoseReading

Array = NDArray[np.float64]

_BAD_TOUCH = 3.0
"""Times the noise of all at which a pose is flagged: pure chance does so once in 30 poses over three axes."""


def touched(poses: tuple[str, ...], form: PoseForm, arm: RobotChoice) -> CalibrationResult:
    """The tip by touch, as a result. Raises: InputError, RefusedError as the parts do."""
    from calibrant.calibrate.tool import tip_by_touch

    raw = form.read(poses, arm)

    def attempt(reading: PoseReading) -> ToolTip:
        return tip_by_touch(_poses(reading))

    chosen = best_reading(raw, attempt, lambda tip: tip.sigma)
    return _result(chosen.outcome, chosen.reading.description, [*poses, *arm.files])


def seen(poses: tuple[str, ...], form: PoseForm, arm: RobotChoice, pixels: Path, result: Path) -> CalibrationResult:
    """The tip by sight, as a result. Raises: InputError, RefusedError as the parts do."""
    from calibrant.calibrate.tool import tip_by_sight
    from calibrant.data.result_file import read_result
    from calibrant.formats.pairing import match_by_order, match_raw

    known = read_result(result)
    camera, base_camera = known.camera, known.transform("base", "camera")
    table = read_columns(pixels, ("u", "v"))
    names = table.names or tuple(str(i) for i in range(len(table.values)))
    raw = form.read(poses, arm)
    pairing = match_by_order(len(raw), names) if table.names is None else match_raw(raw, names)
    uv = table.values[list(pairing.view_index)]

    def attempt(reading: PoseReading) -> ToolTip:
        paired = reading.take(list(pairing.pose_index), [names[v] for v in pairing.view_index])
        return tip_by_sight(_poses(paired), uv, camera=camera, base_camera=base_camera)

    chosen = best_reading(raw, attempt, lambda tip: tip.sigma)
    return _result(chosen.outcome, chosen.reading.description, [*poses, pixels, result, *arm.files])


def self_visible(
    image: Path, features: Path, camera_file: Path, target: str | None, sigma_px: float, *, quiet: bool
) -> CalibrationResult:
    """The hand camera by self-visibility, as a result. Raises: InputError, RefusedError as the parts do."""
    from calibrant.calibrate.provenance import stamp
    from calibrant.calibrate.self_visibility import calibrate_self_visibility
    from calibrant.calibrate.target_poses import target_poses
    from calibrant.data import CalibrationResult, Check
    from calibrant.formats.camera_files import read_camera

    if target is None:
        raise InputError("the photo needs the board it shows: --target, such as chessboard:9x6:25mm")
    table = read_columns(features, ("u", "v", "x_mm", "y_mm", "z_mm"))
    observations = session.detect_boards([image], target, mirror_x=False, workers=None, quiet=quiet, cache="none")
    if not observations.views:
        raise InputError(f"{image}: {observations.missed[0].reason if observations.missed else 'no board found'}")
    view = observations.views[0]
    camera = read_camera(camera_file, image_size=next(iter(observations.image_sizes.values())))
    found = target_poses(camera, [view])
    # 2n residuals and 6 unknowns of the pose; rms is per point over both axes.
    spare = max(2 * len(view) - 6, 1)
    variance = float(found.rms_px[0] ** 2) * len(view) / spare
    answer = calibrate_self_visibility(
        camera, found.T_camera_target[0], table.values[:, :2], 1e-3 * table.values[:, 2:],
        sigma_px=sigma_px, covariance_target=variance * found.covariance[0],
    )  # fmt: skip
    text = (
        f"the gripper's features lie {answer.misfit_mm:.3g} mm from where they should on the board; "
        f"{answer.sigma_misfit_mm:.3g} mm is explained by the noise"
    )
    checks = (Check("features", "ok", text, answer.misfit_mm),)
    return stamp(
        CalibrationResult(
            "self-visibility", "ok", checks, cameras={"camera": camera}, transforms=(answer.gripper_camera,),
            inputs=session.file_records([image, features, camera_file]),
        )
    )  # fmt: skip


class Columns:
    """Numbers of named columns (n, k), and the rows' names where there is a column `image`."""

    def __init__(self, values: Array, names: tuple[str, ...] | None) -> None:
        self.values, self.names = values, names


def read_columns(path: Path, columns: Sequence[str]) -> Columns:
    """Read named columns of a CSV file. Raises: InputError naming the file, the line and what was expected."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read {path}: expected a CSV file with the columns {', '.join(columns)}") from error
    reader = csv.DictReader(text.splitlines(), skipinitialspace=True)
    missing = [c for c in columns if c not in (reader.fieldnames or ())]
    if missing:
        raise InputError(f"{path}: no column {missing[0]!r}; expected the header {','.join(columns)}")
    rows, names = [], []
    for line, row in enumerate(reader, start=2):
        try:
            numbers = [float(row[c] or "") for c in columns]
        except ValueError:
            numbers = [float("nan")]
        if not np.all(np.isfinite(numbers)):
            raise InputError(f"{path}:{line}: expected a finite number in each of {', '.join(columns)}")
        rows.append(numbers)
        names.append(row.get("image") or "")
    if not rows:
        raise InputError(f"{path}: the header stands alone; expected a row for each")
    return Columns(np.array(rows), tuple(names) if all(names) else None)


def _poses(reading: PoseReading) -> RobotPoses:
    from calibrant.data import RobotPoses

    return RobotPoses(reading.ids, reading.T_base_gripper, reading.description)


def _result(tip: ToolTip, reading: str, files: Sequence[str | Path]) -> CalibrationResult:
    from calibrant.calibrate.provenance import stamp
    from calibrant.data import CalibrationResult, Check, ViewResult, as_transform, verdict_of
    from calibrant.geometry import se3

    covariance = np.zeros((6, 6))
    covariance[3:, 3:] = tip.covariance
    worst = int(np.argmax(tip.residuals))
    text = f"the poses agree on the tip to {tip.sigma:.3g} {tip.unit} (1 sigma per axis)"
    # Over three (or two) axes a residual's length is larger than the sigma of one.
    limit = _BAD_TOUCH * tip.sigma * np.sqrt(3 if tip.unit == "mm" else 2)
    odd = tip.residuals[worst] > limit > 0 and len(tip.residuals) > 4
    if odd:
        text += f"; pose {tip.ids[worst]} is off by {tip.residuals[worst]:.3g} {tip.unit}: repeat it, or leave it out"
    checks = (Check("agreement", "warn" if odd else "ok", text, tip.sigma), Check("pose-reading", "ok", reading))
    views = tuple(
        ViewResult(
            name, True, 1, float(r) if tip.unit == "px" else None, None if tip.unit == "px" else f"{r:.3g} mm off"
        )
        for name, r in zip(tip.ids, tip.residuals)
    )
    options = {} if tip.point is None else {"touched_point_mm": [round(1e3 * float(c), 6) for c in tip.point]}
    return stamp(
        CalibrationResult(
            "tool", verdict_of(checks), checks, views=views, options=options, inputs=session.file_records(files),
            transforms=(as_transform("flange", "tip", se3.make(np.eye(3), tip.tip), covariance),),
            sigma_px=tip.sigma if tip.unit == "px" else None,
        )
    )  # fmt: skip
