"""A simulated cell's result beside its truth: error beside predicted error, and whether the truth is where promised."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from calibrant.data import CalibrationResult
from calibrant.reports.parts.numbers import sigma_text, value_text
from calibrant.simulate.cell import Cell
from calibrant.simulate.scenes import Setup
from calibrant.simulate.truth import CONFIDENCE, PointTruth, TransformTruth, point_truth, transform_truth


@dataclass(frozen=True, eq=False)
class Compared:
    """A hand-eye result with the cell it was made in: what of its transforms, and of a workpiece, is truly wrong."""

    cell: Cell
    hand_eye: CalibrationResult
    camera_truth: TransformTruth
    target_truth: TransformTruth
    tool_point: PointTruth


def compared(cell: Cell, hand_eye: CalibrationResult) -> Compared:
    """The result beside the truth of its cell."""
    camera, target = (hand_eye.transform(*name.split("_")[1:]) for name in truth_names(cell.setup))
    return Compared(
        cell,
        hand_eye,
        transform_truth(camera, cell.X),
        transform_truth(target, cell.Z),
        point_truth(camera, cell.X, cell.workpiece),
    )


def truth_names(setup: Setup) -> tuple[str, str]:
    """Names of X and Z."""
    return ("T_gripper_camera", "T_base_target") if setup == "eye-in-hand" else ("T_base_camera", "T_gripper_target")


def comparison(at: Compared) -> RenderableType:
    """Error beside predicted error, parameter by parameter, and whether the truth lies where it was promised."""
    X_name, Z_name = truth_names(at.cell.setup)
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    table.add_column("")
    for heading in ("truth", "found", "error", "predicted 1σ", "error / σ"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("unit")
    _camera_rows(table, at)
    _transform_rows(table, X_name, at.cell.X, at.camera_truth)
    _transform_rows(table, Z_name, at.cell.Z, at.target_truth)
    return Group(Text("Against the truth", style="bold"), table, Text(), _truth_verdict(at))


def _camera_rows(table: Table, at: Compared) -> None:
    found, truth = at.hand_eye.camera, at.cell.camera.parameters
    table.add_row(Text("camera", style="bold"))
    for name, unit in zip(found.model.parameter_names, found.model.parameter_units):
        error = found.parameters[name] - truth[name]
        _truth_row(table, f"  {name}", truth[name], error, found.sigma[name], "" if unit == "1" else unit)


def _transform_rows(table: Table, name: str, T_true: NDArray[np.float64], truth: TransformTruth) -> None:
    table.add_row(Text(name, style="bold"))
    for i, axis in enumerate("xyz"):
        # The comparison is truth minus estimate; a table of errors says estimate minus truth.
        _truth_row(table, f"  {axis}", 1e3 * T_true[i, 3], -1e3 * truth.error[3 + i], 1e3 * truth.sigma[3 + i], "mm")
    for i, axis in enumerate("xyz"):
        error, sigma = (float(np.rad2deg(v)) for v in (-truth.error[i], truth.sigma[i]))
        _truth_row(table, f"  about {axis}", None, error, sigma, "deg")


def _truth_row(table: Table, name: str, truth: float | None, error: float, sigma: float, unit: str) -> None:
    absolute = ("", "") if truth is None else (value_text(truth, sigma), value_text(truth + error, sigma))
    table.add_row(name, *absolute, value_text(error, sigma), sigma_text(sigma), f"{error / sigma:+.1f}", unit)


def _truth_verdict(at: Compared) -> Text:
    camera, point = at.camera_truth, at.tool_point
    X_name, _ = truth_names(at.cell.setup)
    distance = 1e3 * float(at.cell.workpiece[2])
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
