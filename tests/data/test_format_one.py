"""Files of format calibrant/1, written before format 2 was: each kind is read, all that was found in its place."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from calibrant.data import CalibrationResult, Measured
from calibrant.data.details import (
    BentTarget,
    Faults,
    FreeTarget,
    JointAxes,
    ModelChoice,
    PictureRegion,
    RobotParameters,
    TouchedPoint,
)
from calibrant.data.result_file import read_result, write_result
from calibrant.errors import InputError

FOLDER = Path(__file__).parent / "format_one"
FILES = sorted(FOLDER.glob("*.json"))
FOUND = {
    "offset_s", "offset_sigma_s", "parameters", "axes", "rms_before", "rms_after", "sigma_px_of", "sigma_robot_of",
    "sigma_joint_deg", "pictures", "cameras", "camera", "pose_reading", "findings", "repaired", "loop_before",
    "loop_after", "model_choice", "touched_point_mm", "off_mm", "measurements", "shares", "valid_region",
    "without_source",
}  # fmt: skip
"""What format 1 kept among the options though nobody had asked it."""


def old(name: str) -> CalibrationResult:
    return read_result(FOLDER / f"{name}.json")


def options_of(name: str) -> dict:
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))["options"]


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_every_kind_is_read_and_goes_round_in_format_2(file: Path, tmp_path: Path) -> None:
    data = json.loads(file.read_text(encoding="utf-8"))
    assert data["format"] == "calibrant/1"
    result = read_result(file)
    assert not FOUND & set(result.options)
    path = write_result(result, tmp_path / "two.json")
    written = json.loads(path.read_text(encoding="utf-8"))
    assert written["format"] == "calibrant/2"
    # What is not an option is as it was, but for rotations, which reading makes rotations again.
    for key in data.keys() - {"format", "options", "robot_poses", "target_shape"}:
        assert written[key] == data[key], key
    again = read_result(path)
    assert again.figures == result.figures
    assert (again.options, again.decided, again.cell, again.details) == (
        result.options, result.decided, result.cell, result.details,
    )  # fmt: skip


def test_figures_keep_their_digits() -> None:
    options = options_of("time-offset")
    assert old("time-offset").figures == {"offset": Measured(options["offset_s"], options["offset_sigma_s"], "s")}
    loops = options_of("doctor")
    assert old("doctor").figures["loop_before_mm"] == Measured(loops["loop_before"]["mm"], unit="mm")
    assert old("doctor").decided == {"pose_reading": loops["pose_reading"], "setup": loops["setup"]}
    shares = options_of("dynamic")["shares"]
    assert {f"variance by {k}": Measured(v) for k, v in shares.items()} == old("dynamic").figures
    errors = options_of("kinematics-axes")["rms_after"]
    assert old("kinematics-axes").figures["rms_after_deg"] == Measured(errors["deg"], unit="deg")


def test_records_keep_their_digits() -> None:
    rows = options_of("kinematics")["parameters"]
    parameters = old("kinematics").detail(RobotParameters)
    assert parameters is not None
    assert [(p.name, p.correction, p.sigma, p.reason, p.group) for p in parameters.robots["robot"]] == [
        (r["name"], r["correction"], r.get("sigma"), r.get("reason"), r["group"]) for r in rows
    ]
    first = options_of("kinematics-axes")["axes"][0]
    axes = old("kinematics-axes").detail(JointAxes)
    assert axes is not None
    assert list(axes.axes[0].direction) == first["direction"]
    assert axes.axes[0].sigma_point_mm == first["sigma_point_mm"]
    choice = old("intrinsics-auto").detail(ModelChoice)
    assert choice is not None
    assert [c.model for c in choice.candidates] == ["pinhole", "brown", "rational"]
    assert old("intrinsics-auto").options["model"] == "auto"
    touched, options = old("tool").detail(TouchedPoint), options_of("tool")
    assert touched is not None
    assert (list(touched.point_mm), touched.off_mm) == (options["touched_point_mm"], options["off_mm"])
    assert old("undistorted").detail(PictureRegion) == PictureRegion(*options_of("undistorted")["valid_region"])
    faults = old("doctor").detail(Faults)
    assert faults is not None
    assert [f.name for f in faults.found] == ["poses-shifted", "board-flipped"]
    assert faults.found[1].views == ("4.png",)
    assert old("hand-eye-repaired").detail(Faults) == faults


def test_a_target_keeps_its_shape() -> None:
    was = json.loads((FOLDER / "intrinsics-shape.json").read_text(encoding="utf-8"))["target_shape"]
    bent = old("intrinsics-shape").detail(BentTarget)
    assert bent is not None
    assert (list(bent.bend_mm), list(bent.bend_sigma_mm), bent.largest_mm) == (
        was["bend_mm"], was["bend_sigma_mm"], was["largest_mm"],
    )  # fmt: skip
    was = json.loads((FOLDER / "intrinsics-free.json").read_text(encoding="utf-8"))["target_shape"]
    free = old("intrinsics-free").detail(FreeTarget)
    assert free is not None
    assert {name: list(d) for name, d in free.deviation_mm.items()} == was["deviation_mm"]
    assert (free.points, free.typical_sigma_mm) == (was["points"], was["typical_sigma_mm"])


def test_a_cell_keeps_its_lists_and_its_noise() -> None:
    cell, options = old("hand-eye-cell").cell, options_of("hand-eye-cell")
    assert cell is not None
    assert [(p.camera, p.robot, p.setup) for p in cell.pictures] == [
        ("one", "a", "eye-in-hand"), ("two", "b", "eye-in-hand"),
    ]  # fmt: skip
    assert cell.sigma_px == options["sigma_px_of"]
    assert {r: (s.mm, s.deg) for r, s in cell.sigma_robot.items()} == {
        r: (s["mm"], s["deg"]) for r, s in options["sigma_robot_of"].items()
    }
    assert old("hand-eye-cell").decided == {"camera one": "given", "camera two": "given"}


def test_a_finding_that_is_not_as_format_1_wrote_it_is_said(tmp_path: Path) -> None:
    data = json.loads((FOLDER / "time-offset.json").read_text(encoding="utf-8"))
    del data["options"]["offset_sigma_s"]
    path = tmp_path / "cut.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(InputError, match=r"options is not as calibrant/1 has it.*offset_sigma_s"):
        read_result(path)
