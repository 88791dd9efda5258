"""The demo's work: a simulated cell photographed, calibrated as a user would, and compared with its truth."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.data import CalibrationResult
from calibrant.data.result_encoding import encode
from calibrant.data.result_file import write_result, write_text
from calibrant.errors import InputError, RefusedError
from calibrant.reports.html import write_report
from calibrant.reports.parts.numbers import sigma_text, value_text
from calibrant.simulate.cell import Cell, make_cell, photograph
from calibrant.simulate.scenes import Setup
from calibrant.simulate.truth import CONFIDENCE, PointTruth, TransformTruth, point_truth, transform_truth
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.robots.hand_eye import Request, run

MARK = "truth.json"
"""The file by which a demo knows a folder that it wrote itself, and may therefore write again."""


@dataclass(frozen=True, eq=False)
class DemoOutcome:
    """What came out: the cell with its truth, both results, the comparison, the files, the time each step took."""

    cell: Cell
    intrinsics: CalibrationResult
    hand_eye: CalibrationResult
    camera_truth: TransformTruth
    target_truth: TransformTruth
    tool_point: PointTruth
    files: dict[str, Path]
    seconds: dict[str, float]


def run_demo(folder: Path, *, seed: int, views: int, setup: Setup, listener: Listener = SILENT) -> DemoOutcome:
    """Photograph a cell into `folder` and calibrate it from these files alone, as `calibrant hand-eye` does.

    Raises: InputError when the folder holds something that no demo wrote, or cannot be written; RefusedError when the
    calibration refuses its data.
    """
    cell = make_cell(seed, setup=setup, views=views)
    _claim(folder)
    clock = _Clock()
    write_text(_truth_text(cell), folder / MARK, force=True)
    with listener.progress("Photographing the board") as step:
        images, poses = photograph(cell, folder, progress=lambda done, total: step(done, total, ""))
    clock.lap("photograph")
    request = Request(poses=(str(poses),), images=(str(images[0].parent),), target=(cell.target.spec,), setup=(setup,))
    hand_eye = run(request, listener).result
    clock.lap("detect and calibrate")
    if hand_eye is None or hand_eye.observations is None or len(hand_eye.transforms) != 2:
        raise RefusedError(
            "the calibration of the simulated cell gave no transforms; run again with --debug, report it"
        )
    intrinsics = calibrate_intrinsics(hand_eye.observations)
    files = {
        "images": images[0].parent,
        "robot poses": poses,
        "camera": write_result(intrinsics, folder / "camera.json", force=True),
        "hand-eye": write_result(hand_eye, folder / "hand-eye.json", force=True),
        "report": write_report(hand_eye, folder / "report.html", force=True),
    }
    clock.lap("report")
    return _compared(cell, intrinsics, hand_eye, files, clock.laps)


def _compared(
    cell: Cell,
    intrinsics: CalibrationResult,
    hand_eye: CalibrationResult,
    files: dict[str, Path],
    laps: dict[str, float],
) -> DemoOutcome:
    X_name, Z_name = _names(cell.setup)
    camera_estimate, target_estimate = (hand_eye.transform(*name.split("_")[1:]) for name in (X_name, Z_name))
    return DemoOutcome(
        cell,
        intrinsics,
        hand_eye,
        transform_truth(camera_estimate, cell.X),
        transform_truth(target_estimate, cell.Z),
        point_truth(camera_estimate, cell.X, cell.workpiece),
        files,
        laps,
    )


class _Clock:
    """Time between laps, by name."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name] = now - self._last
        self._last = now


def _claim(folder: Path) -> None:
    """Make the folder, or clear the pictures of the demo that wrote it; anything else is not ours to touch."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; the demo writes a folder: choose another one with --out")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / MARK).is_file():
        raise InputError(
            f"{folder} is not empty and no demo wrote it, so it is left as it is; choose another folder with --out"
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for old in (folder / "images").glob("[0-9]*.png"):
            old.unlink()  # an earlier demo with more views would leave pictures without a pose
    except OSError as error:
        raise InputError(f"cannot write to {folder}: {error.strerror}; choose another folder with --out") from error


def _truth_text(cell: Cell) -> str:
    X_name, Z_name = _names(cell.setup)
    truth = {
        "seed": cell.seed,
        "setup": cell.setup,
        "target": cell.target.spec,
        "camera": cell.camera.parameters,
        X_name: cell.X.tolist(),
        Z_name: cell.Z.tolist(),
    }
    return json.dumps(truth, indent=1) + "\n"


def _names(setup: Setup) -> tuple[str, str]:
    """Names of X and Z."""
    return ("T_gripper_camera", "T_base_target") if setup == "eye-in-hand" else ("T_base_camera", "T_gripper_target")


def result_json(outcome: DemoOutcome) -> dict[str, Any]:
    """The hand-eye result in the format of result files, with the comparison under `truth`."""
    camera, point = outcome.camera_truth, outcome.tool_point
    truth = {
        "matrix": outcome.cell.X.tolist(),
        "error_translation_mm": camera.translation_mm,
        "error_rotation_deg": camera.rotation_deg,
        "normalised_error": camera.normalised,
        "limit": camera.limit,
        "inside": camera.inside,
        "tool_point_error_mm": point.error_mm,
        "tool_point_sigma_mm": point.sigma_mm,
        "camera": outcome.cell.camera.parameters,
        "seconds": outcome.seconds,
    }
    return {**encode(outcome.hand_eye), "truth": truth}


def comparison(outcome: DemoOutcome) -> RenderableType:
    """Error beside predicted error, parameter by parameter, and whether the truth lies where it was promised."""
    X_name, Z_name = _names(outcome.cell.setup)
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    table.add_column("")
    for heading in ("truth", "found", "error", "predicted 1σ", "error / σ"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("unit")
    _camera_rows(table, outcome)
    _transform_rows(table, X_name, outcome.cell.X, outcome.camera_truth)
    _transform_rows(table, Z_name, outcome.cell.Z, outcome.target_truth)
    return Group(Text("Against the truth", style="bold"), table, Text(), _verdict(outcome))


def _camera_rows(table: Table, outcome: DemoOutcome) -> None:
    found, truth = outcome.hand_eye.camera, outcome.cell.camera.parameters
    table.add_row(Text("camera", style="bold"))
    for name, unit in zip(found.model.parameter_names, found.model.parameter_units):
        error = found.parameters[name] - truth[name]
        _row(table, f"  {name}", truth[name], error, found.sigma[name], "" if unit == "1" else unit)


def _transform_rows(table: Table, name: str, T_true: NDArray[np.float64], truth: TransformTruth) -> None:
    table.add_row(Text(name, style="bold"))
    for i, axis in enumerate("xyz"):
        # The comparison is truth minus estimate; a table of errors says estimate minus truth.
        _row(table, f"  {axis}", 1e3 * T_true[i, 3], -1e3 * truth.error[3 + i], 1e3 * truth.sigma[3 + i], "mm")
    for i, axis in enumerate("xyz"):
        error, sigma = (float(np.rad2deg(v)) for v in (-truth.error[i], truth.sigma[i]))
        _row(table, f"  about {axis}", None, error, sigma, "deg")


def _row(table: Table, name: str, truth: float | None, error: float, sigma: float, unit: str) -> None:
    absolute = ("", "") if truth is None else (value_text(truth, sigma), value_text(truth + error, sigma))
    table.add_row(name, *absolute, value_text(error, sigma), sigma_text(sigma), f"{error / sigma:+.1f}", unit)


def _verdict(outcome: DemoOutcome) -> Text:
    camera, point = outcome.camera_truth, outcome.tool_point
    X_name, _ = _names(outcome.cell.setup)
    distance = 1e3 * float(outcome.cell.workpiece[2])
    where = "inside" if camera.inside else "OUTSIDE"
    text = Text()
    text.append(f"{X_name} is off by {camera.translation_mm:.2f} mm and {camera.rotation_deg:.3f} deg. ")
    text.append(
        f"The truth lies {where} the predicted {100 * CONFIDENCE:.0f} % region "
        f"(normalised error {camera.normalised:.1f}, limit {camera.limit:.1f}).\n",
        style="bold green" if camera.inside else "bold red",
    )
    text.append(
        f"Tool point: a workpiece {distance:.0f} mm in front of the camera is placed {point.error_mm:.2f} mm off; "
        f"predicted {point.sigma_mm:.2f} mm RMS.\n"
    )
    return text
