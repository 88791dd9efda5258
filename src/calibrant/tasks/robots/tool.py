"""What `calibrant tool` does: read, calibrate, and put it as a result."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibrant.cli import session
from calibrant.errors import InputError
from calibrant.tasks.inputs.pose_choice import PoseForm, best_reading
from calibrant.tasks.inputs.robot_choice import RobotChoice

if TYPE_CHECKING:
    from calibrant.calibrate.tool.tip import ToolTip
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult, Check, RobotPoses, TransformEstimate
    from calibrant.formats.poses.read import PoseNotation

Array = NDArray[np.float64]

ODD = 0.01
"""Chance below which some pose is flagged when all are good: once in a hundred tools."""
LEVER = 10.0
"""Times the noise of a touch that the tip may be uncertain by: turns of some 6 degrees, where 30 leave two times it."""
NOT_A_TIP_PX = 20.0
"""Noise per axis of pixels that show another thing than the tip, or another session: no one clicks that badly."""
LARGE_MM, LARGE_DEG = 2.0, 1.0
"""A hand camera is not known well enough to grasp with when it is known worse than this."""


def touched(poses: tuple[str, ...], form: PoseForm, arm: RobotChoice) -> CalibrationResult:
    """The tip by touch, as a result. Raises: InputError, RefusedError as the parts do."""
    from calibrant.calibrate.tool.tip import tip_by_touch

    raw = form.read(poses, arm)

    def attempt(reading: PoseNotation) -> ToolTip:
        return tip_by_touch(_poses(reading))

    chosen = best_reading(raw, attempt, lambda tip: tip.sigma)
    return _result(chosen.outcome, chosen.reading.description, [*poses, *arm.files])


def seen(poses: tuple[str, ...], form: PoseForm, arm: RobotChoice, pixels: Path, result: Path) -> CalibrationResult:
    """The tip by sight, as a result. Raises: InputError, RefusedError as the parts do."""
    from calibrant.calibrate.tool.tip import tip_by_sight
    from calibrant.data.result_file import read_result
    from calibrant.formats.poses.pairing import match_by_order, match_raw

    known = read_result(result)
    camera, base_camera, covariance = _standing(known, result)
    table = read_columns(pixels, ("u", "v"))
    names = table.names or tuple(str(i) for i in range(len(table.values)))
    raw = form.read(poses, arm)
    pairing = match_by_order(len(raw), names) if table.names is None else match_raw(raw, names)
    uv = table.values[list(pairing.view_index)]

    def attempt(reading: PoseNotation) -> ToolTip:
        paired = reading.take(list(pairing.pose_index), [names[v] for v in pairing.view_index])
        return tip_by_sight(_poses(paired), uv, camera=camera, base_camera=base_camera, covariance=covariance)

    chosen = best_reading(raw, attempt, lambda tip: tip.sigma, fits=lambda tip: tip.sigma < NOT_A_TIP_PX, what=(
        "no reading of the poses puts one tip where the pixels are; do poses, pixels and --result belong to one "
        "session?"
    ))  # fmt: skip
    return _result(chosen.outcome, chosen.reading.description, [*poses, pixels, result, *arm.files])


def _standing(known: CalibrationResult, path: Path) -> tuple[Camera, TransformEstimate, Array | None]:
    """The camera that stands still, T_base_camera, and the covariance of both together where the result tells it.

    Raises: InputError for a result of another kind.
    """
    from calibrant.diagnose.budget.single import error_budget

    place = next((t for t in known.transforms if (t.parent, t.child) == ("base", "camera")), None)
    if place is None or len(known.cameras) != 1:
        there = ", ".join(f"{t.parent} -> {t.child}" for t in known.transforms) or "no transform"
        raise InputError(
            f"{path}: expected the hand-eye result of a camera that stands still (base -> camera, eye-to-hand); it has "
            f"{there}. A camera on the gripper cannot tell where a tool on that gripper is"
        )
    if known.kind != "hand-eye" or known.observations is None:
        return known.camera, place, None
    rows = np.r_[0:6, 12 : 12 + len(known.camera.values)]
    return known.camera, place, error_budget(known).covariance[np.ix_(rows, rows)]


def self_visible(
    image: Path, features: Path, camera_file: Path, target: str | None, sigma_px: float, *, quiet: bool
) -> CalibrationResult:
    """The hand camera by self-visibility, as a result. Raises: InputError, RefusedError as the parts do."""
    from calibrant.calibrate.pose.target_poses import target_poses
    from calibrant.calibrate.tool.self_visibility import calibrate_self_visibility, moved_by_camera
    from calibrant.data import CalibrationResult, Check, verdict_of
    from calibrant.data.verdicts import stamp
    from calibrant.formats.cameras.read import read_camera

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
        target_by_camera=moved_by_camera(camera, view, found.T_camera_target[0]),
    )  # fmt: skip
    text = (
        f"the gripper's features lie {answer.misfit_mm:.3g} mm from where they should on the board; "
        f"{answer.sigma_misfit_mm:.3g} mm is explained by the noise, {sigma_px:g} px a feature (--sigma-px)"
    )
    checks = (Check("features", "ok", text, answer.misfit_mm), _certainty(answer.gripper_camera, len(table.values)))
    return stamp(
        CalibrationResult(
            "self-visibility", verdict_of(checks), checks, cameras={"camera": camera},
            transforms=(answer.gripper_camera,), inputs=session.file_records([image, features, camera_file]),
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


def _poses(reading: PoseNotation) -> RobotPoses:
    from calibrant.data import RobotPoses

    return RobotPoses(reading.ids, reading.T_base_gripper, reading.description)


def _result(tip: ToolTip, reading: str, files: Sequence[str | Path]) -> CalibrationResult:
    from calibrant.data import CalibrationResult, Check, ViewResult, as_transform, verdict_of
    from calibrant.data.details import TouchedPoint
    from calibrant.data.verdicts import stamp
    from calibrant.geometry import se3

    covariance = np.zeros((6, 6))
    covariance[3:, 3:] = tip.covariance
    checks = (_agreement(tip), _tip_certainty(tip), Check("pose-reading", "ok", reading))
    odd = tip.chances < ODD / len(tip.chances)
    views = tuple(
        ViewResult(
            name, True, 1, float(r) if tip.unit == "px" else None,
            f"{r:.3g} {tip.unit} off, at odds with the others" if bad else None,
        )
        for name, r, bad in zip(tip.ids, tip.residuals, odd)
    )  # fmt: skip
    details: tuple[TouchedPoint, ...] = ()
    if tip.point is not None:
        x, y, z = (round(1e3 * float(c), 6) for c in tip.point)
        off = {name: round(float(r), 6) for name, r in zip(tip.ids, tip.residuals)}
        details = (TouchedPoint((x, y, z), off),)
    return stamp(
        CalibrationResult(
            "tool", verdict_of(checks), checks, views=views, decided={"pose_reading": reading}, details=details,
            inputs=session.file_records(files),
            transforms=(as_transform("flange", "tip", se3.make(np.eye(3), tip.tip), covariance),),
            sigma_px=tip.sigma if tip.unit == "px" else None,
        )
    )  # fmt: skip


def _agreement(tip: ToolTip) -> Check:
    from calibrant.data import Check

    text = f"the poses agree on the tip to {tip.sigma:.3g} {tip.unit} (1 sigma per axis)"
    worst = int(np.argmin(tip.chances))
    far = int(np.argmax(tip.residuals))
    if tip.chances[worst] < ODD / len(tip.chances):
        text += (
            f"; {tip.ids[worst]} is off by {tip.residuals[worst]:.3g} {tip.unit}, at odds with the others: "
            "repeat it, or leave it out"
        )
        return Check("agreement", "warn", text, tip.sigma)
    return Check("agreement", "ok", f"{text}; farthest {tip.ids[far]}, {tip.residuals[far]:.3g} {tip.unit}", tip.sigma)


def _tip_certainty(tip: ToolTip) -> Check:
    from calibrant.data import Check

    mm = float(1e3 * np.sqrt(np.linalg.eigvalsh(tip.covariance)[-1]))
    text = f"the tip is known to {mm:.2g} mm (1 sigma, worst direction)"
    if tip.unit == "mm" and mm > LEVER * tip.sigma > 0:
        text += (
            f", {mm / tip.sigma:.0f} times what the touches agree to: tilt the tool further between them, 30 degrees"
        )
        return Check("certainty", "warn", text, mm)
    if tip.unit == "px":
        text += f"; {100 * tip.of_camera:.0f} % of its variance is the camera's own place and lens"
    return Check("certainty", "ok", text, mm)
