"""The result file: lossless round trip, atomic writes, messages for files that are not results."""

from __future__ import annotations

import dataclasses
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibrant.cameras import Camera
from calibrant.data import (
    CalibrationResult,
    CellLayout,
    Check,
    HeldOut,
    Measured,
    MethodResult,
    Missed,
    Observations,
    PictureList,
    RobotPoses,
    SigmaRobot,
    TransformEstimate,
    View,
    ViewResult,
)
from calibrant.data.details import (
    DETAILS,
    ArmError,
    ArmErrors,
    BentTarget,
    CameraClock,
    CameraClocks,
    Changes,
    Comparison,
    Deviations,
    EpipolarErrors,
    EpipolarMatrices,
    Expectation,
    Fault,
    Faults,
    FreeTarget,
    JointAxes,
    JointAxis,
    LocatedObject,
    LoopSpread,
    MarkedPoints,
    ModelCandidate,
    ModelChoice,
    PairErrors,
    PhotoShift,
    PictureRegion,
    PlannedPose,
    PointedSpot,
    PossibleChange,
    RectifiedPair,
    ReferencePicture,
    RobotParameter,
    RobotParameters,
    RollingShutter,
    ServoTrace,
    SharedErrors,
    SharedMoments,
    StereoGeometry,
    TaskRun,
    TaskRuns,
    TaughtFeatures,
    TouchedPoint,
    TriangulatedEdges,
    ViewDeviation,
    ViewMotion,
    ViewPlan,
    WatchedPicture,
    Watching,
)
from calibrant.data.details_comparison import (
    CameraComparison,
    DifferenceMap,
    ParameterDifference,
    TransformComparison,
)
from calibrant.data.details_scene import ProjectorCapture, ProjectorCaptures
from calibrant.data.records.servoing import ServoSample
from calibrant.data.result_file import read_observations, read_result, write_observations, write_result
from calibrant.errors import InputError
from calibrant.geometry import se3, so3

LEVEL = (1.0, 0.0, 1 / 3, 0.0)
TURNED = ((1 / 3, 0.1, 0.2), (0.3, 1 / 7, 0.5), (0.0, 0.0, 1.0))


def details() -> tuple[object, ...]:
    """A record of every class that is registered."""
    return (
        ArmErrors({"a": ArmError(0.1, 0.2, 1 / 3, False)}),
        RobotParameters(
            {"a": (RobotParameter("q1", "rad", 0.1 + 0.2, 1 / 3), RobotParameter("q2", "m", 0.0, None, "no"))}
        ),
        JointAxes((JointAxis("q1", "revolute", (0.0, 0.0, 1.0), (1 / 3, 0.0, 0.1), 0.01, None),)),
        BentTarget((0.1 + 0.2, -1.5), (1 / 3, 0.1), 0.5, -0.2, 1 / 7),
        FreeTarget(2, 0.1, 1 / 3, 0.5, 0.01, {"0": (0.1, 0.2, 1 / 7), "1": (0.0, 0.0, -0.5)}),
        ModelChoice((ModelCandidate("brown", 9, 0.1, 0.2, -1.5), ModelCandidate("tilted", 0, reason="no"))),
        CameraClocks(
            "a", (CameraClock("b", 0.1 + 0.2, 1 / 3), CameraClock("c", readout_ms=30.0, readout_sigma_ms=0.1))
        ),
        SharedErrors(2.0, 1.5, 1 / 3, 1.0, {"fx": 0.1 + 0.2}),
        ProjectorCaptures(
            "gray",
            42,
            (
                ProjectorCapture("0", 63, 60, 0.5, 1 / 3, 0.0, 0.29, 1.5, -0.01, 0.1, None, 0.2),
                ProjectorCapture("1", 63, 0, 0.1, 0.2, 0.0, 1.0, 1.5, 0.0),
            ),
        ),
        RollingShutter(
            480,
            1 / 3,
            0.1,
            {"0": ViewMotion((0.1, 1 / 7), (0.1, 0.2), (0.0, 0.1, 1 / 3), (0.1, 0.0, -1.0), (0.1, 0.2, 0.0))},
        ),
        Faults(
            (
                Fault(
                    "flip", "warn", "σ", 0.9, LoopSpread(1.5, 0.1), LoopSpread(0.1, 1 / 3), 1.0, None, ("0",), "turn"
                ),
                Fault("size", "fail", "big", 1.0),
            )
        ),
        Deviations((ViewDeviation("0", 1 / 3, 0.1, 0.1, 0.2), ViewDeviation("1"))),
        TouchedPoint((1 / 3, 2.0, 3.0), {"0": 0.1}),
        TaughtFeatures(
            "marker",
            "eye-in-hand",
            (640, 480),
            (3, 4),
            ((0.1, 1 / 3), (2.0, 3.0)),
            (0.1, 0.2),
            (0.5, 1 / 7),
            ((0.0, 0.1, 0.0), (1 / 3, 0.0, 0.0)),
            ((1.0, 0.0, 0.0, 0.1),),
            "picture",
            40,
        ),
        ServoTrace(
            "image",
            (
                ServoSample(0.1, False, 1 / 3, 2.0, 0.1, 0.01, 0.02, 1.2, 30.0, 1 / 7, 0.3, ("the range of joint 2",)),
                ServoSample(0.2, True, 0.1, 0.2, 0.1, 0.01, 0.02, 0.0, 0.0, 0.0),
            ),
        ),
        PictureRegion(1, 2, 30, 40),
        MarkedPoints(1 / 3, {"0": (3, 17)}),
        ViewPlan(
            "A point 1 m ahead",
            Expectation(1 / 3, 2 / 3),
            (PlannedPose("00.png", (0.1, 1 / 3, 0.2), (0.0, 0.0, 0.0, 1.0), {"q1": 1 / 7}, 0.3, 0.6),),
            {"q1": "rad"},
            obstacles=True,
        ),
        Changes(
            "changed",
            "push it back",
            (
                PossibleChange("camera", True, 1e-9, 1 / 3, "moved", (1 / 3, 0.0, 0.1), (0.1, 0.1, 0.1)),
                PossibleChange("lens", False, 0.1, 1e-9, ""),
            ),
            (PhotoShift("0", (640, 480), ((1.5, 1 / 3), (2.0, 3.0)), ((1.0, 0.1), (2.5, 3.5)), "0.png"),),
        ),
        ReferencePicture("then.png", (640, 480), "aGVsbG8="),
        RectifiedPair(
            "pinhole",
            "x",
            1 / 3,
            ((1.5, 2.0), (2.5, 2.0)),
            (640, 480),
            0.12,
            (
                (((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1 / 3))),
                ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
            ),
        ),
        LocatedObject(
            "box", "box of 1x2x3mm", (1 / 3, 2.0), 120, ((LEVEL, LEVEL, LEVEL, LEVEL),), ("the turn",), 2, 1 / 3
        ),
        EpipolarMatrices(((1.0, 0.0, 0.0), (0.0, 1 / 3, 0.0), (0.0, 0.0, 2.0))),
        PointedSpot("m", (1e-6, 1 / 3e7, 2e-6), {"left": (1 / 3, 2.0), "right": (3.0, 4.5)}),
        StereoGeometry("left", "right", TURNED, (1 / 3, 0.0, -0.1), TURNED, TURNED),
        EpipolarErrors(
            1 / 3, 0.0, 0.7, 0.2, {"0": PairErrors("l0", "r0", 1 / 3, 0.0, 0.7, (3, 17), (1 / 7, 0.0), (0.7, 1 / 3))}
        ),
        TriangulatedEdges(12, 1 / 3, -0.01, 25.0),
        SharedMoments(("left", "right"), ((12, 7), (7, 9))),
        Watching("moved", "push", 1e5, (WatchedPicture("0", 1 / 3), WatchedPicture("1", None, "no target")), "0", "1"),
        TaskRuns(
            "pinpoint",
            "base",
            (
                TaskRun("0", True, 1 / 3, 0.5, True, 0, (0.1, 1 / 3, 0.0), (0.1, 0.1, 0.1)),
                TaskRun("1", False, reason="no"),
            ),
            1.0,
            "push",
            {"half a side added": "9 of 10"},
        ),
        Comparison("a.json", "b.json", (_compared(),), (_moved(),), ("left",), ("base → camera",)),
    )


def _compared() -> CameraComparison:
    terms = (ParameterDifference("fx", "px", 1 / 3, 2 / 3, 0.1, None, 1 / 3), ParameterDifference("k1", "1", None, 0.1))
    places = DifferenceMap(2, 1, (0.0, 1 / 3), (0.0, 0.0), (1 / 3, None), (1 / 7, None), (0.1, None))
    sizes = ("left", "cam0", "brown", "pinhole", (640, 480), (320, 240), 1 / 3, 1.0, 1 / 7, 0.5)
    return CameraComparison(*sizes, (1 / 3, 0.0, 1e-9), None, 1 / 3, 1 / 7, 0.9, terms, places)


def _moved() -> TransformComparison:
    return TransformComparison("base", "left", (1 / 3, 0.0, 0.1), (1e-9, 0.0, 0.1), (0.1, 1 / 3, 0.1), None, 0.5)


def full_result() -> CalibrationResult:
    """A result with every field set, from numbers that need all 17 digits."""
    rng = np.random.default_rng(3)
    T = se3.make(so3.random(rng, 3), rng.normal(size=(3, 3)))
    camera = Camera.create(
        "brown",
        {"fx": 1000 / 3, "fy": 1000 / 7, "cx": 321.1, "cy": 0.1 + 0.2, "k1": -0.1},
        image_size=(640, 480),
        covariance=np.cov(rng.normal(size=(9, 30))),
    )
    view = View(
        "ä/0.png",
        rng.normal(size=(4, 3)),
        rng.normal(size=(4, 2)),
        np.arange(4),
        "left",
        "m0",
        np.full(4, 1 / 3),
        "a/0.png",
        covariance_px=np.tile(np.array([[5 / 3, 0.2], [0.2, 1 / 3]]) / 9, (4, 1, 1)),
    )
    plain = View("1", np.zeros((0, 3)), np.zeros((0, 2)), np.arange(0), "left")
    observations = Observations(
        (view, plain),
        {"left": (640, 480)},
        "chessboard:9x6:25mm",
        (Missed("2", "blur", "left", "2.png"),),
        ("A note.",),
    )
    return CalibrationResult(
        kind="hand-eye",
        verdict="warn",
        checks=(Check("rotation-diversity", "warn", "σ is 2 mm", 0.1), Check("pairing", "ok", "by name")),
        cameras={
            "left": camera,
            "right": Camera.create("pinhole", {"fx": 1, "fy": 2, "cx": 3, "cy": 4}, image_size=(8, 6)),
        },
        transforms=(
            TransformEstimate("base", "camera", T[0], np.diag(rng.random(6))),
            TransformEstimate("a", "b", T[1]),
        ),
        rms_px=0.1,
        sigma_px=1 / 3,
        sigma_robot=SigmaRobot(0.1, 0.01, 0.001),
        views=(ViewResult("0", True, 4, 0.2, None, "left", 2, T[2]), ViewResult("1", False, 0, None, "no board")),
        methods={"park": MethodResult(T[0], 1.5, 0.2), "tsai": MethodResult(None, None, None, "parallel axes")},
        target_scale=Measured(1.001, 0.007),
        held_out=HeldOut(mm=1.2, deg=None, px=0.3),
        options={"fix": ["k3"], "max_error_px": 1.0, "seed": 3, "robust": True, "none": None},
        figures={"offset": Measured(0.1 + 0.2, 1 / 3, "s"), "share": Measured(1 / 7)},
        decided={"pose_reading": "metres, quaternions x y z w"},
        cell=CellLayout(
            (PictureList("left", "a", "hand-to-hand", "board", "b"), PictureList("right", "a", "standing", "board")),
            {"left": 0.1 + 0.2, "right": 1 / 3},
            {"a": SigmaRobot(0.1, 0.01, 0.001), "b": SigmaRobot(0.2, 0.02)},
            {"a": 1 / 700},
        ),
        details=details(),
        inputs=({"file": "0.png", "sha256": "ab"},),
        observations=observations,
        robot_poses=RobotPoses(("0", "1", "2"), T, "poses.csv as m"),
        T_camera_target=T,
        created="2024-01-02T03:04:05+00:00",
        version="0.0.9",
    )


def assert_same(a: Any, b: Any, where: str = "result") -> None:
    """Equal to the last bit; robot poses to rounding, because reading projects them onto the rotations again."""
    if where.endswith("T_base_gripper"):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-15)
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b, err_msg=where)
    elif dataclasses.is_dataclass(a):
        for field in dataclasses.fields(a):
            assert_same(getattr(a, field.name), getattr(b, field.name), f"{where}.{field.name}")
    elif isinstance(a, dict):
        assert list(a) == list(b), where
        for key in a:
            assert_same(a[key], b[key], f"{where}.{key}")
    elif isinstance(a, tuple):
        assert len(a) == len(b), where
        for i, (x, y) in enumerate(zip(a, b)):
            assert_same(x, y, f"{where}[{i}]")
    elif isinstance(a, float) and a != a:
        assert b != b, where
    else:
        assert a == b, where


def test_round_trip_keeps_every_field(tmp_path: Path) -> None:
    result = full_result()
    path = write_result(result, tmp_path / "r.json")
    assert_same(result, read_result(path))


def test_every_record_goes_round() -> None:
    assert {type(d) for d in details()} == set(DETAILS.values())


def test_layout_is_the_documented_one(tmp_path: Path) -> None:
    data = json.loads(write_result(full_result(), tmp_path / "r.json").read_text(encoding="utf-8"))
    assert data["format"] == "calibrant/2"
    assert data["cameras"]["left"]["image_size"] == [640, 480]
    assert set(data["transforms"][0]) >= {"parent", "child", "matrix", "sigma_translation_mm", "sigma_rotation_deg"}
    assert data["transforms"][0]["sigma_translation_mm"][0] == pytest.approx(
        1e3 * data["transforms"][0]["covariance"][3][3] ** 0.5
    )
    assert data["views"][1] == {"id": "1", "used": False, "points": 0, "rms_px": None, "reason": "no board"}
    assert data["held_out"] == {"mm": 1.2, "px": 0.3}


def test_keys_that_do_not_apply_are_absent_and_the_date_is_filled_in(tmp_path: Path) -> None:
    path = write_result(CalibrationResult("intrinsics", "ok"), tmp_path / "r.json")
    data = json.loads(path.read_text())
    assert set(data) == {"format", "kind", "version", "created", "verdict"}
    assert data["created"].endswith("+00:00")


def test_observations_file_round_trip(tmp_path: Path) -> None:
    observations = full_result().observations
    assert observations is not None
    path = write_observations(observations, tmp_path / "o.json", options={"target": "x"})
    assert_same(observations, read_observations(path))
    assert read_result(path).kind == "observations"
    empty = write_result(CalibrationResult("intrinsics", "ok"), tmp_path / "i.json")
    with pytest.raises(InputError, match="intrinsics result without observations"):
        read_observations(empty)


def test_an_existing_file_is_replaced_only_by_force(tmp_path: Path) -> None:
    path = tmp_path / "r.json"
    path.write_text("mine")
    with pytest.raises(InputError, match=r"r\.json exists already.*force=True"):
        write_result(full_result(), path)
    assert path.read_text() == "mine"
    write_result(full_result(), path, force=True)
    assert read_result(path).kind == "hand-eye"


def test_a_failed_write_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "r.json"
    path.write_text("mine")

    def full_disk(fd: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(InputError, match=r"cannot write .*no space left on device"):
        write_result(full_result(), path, force=True)
    assert path.read_text() == "mine"
    assert [p.name for p in tmp_path.iterdir()] == ["r.json"]


@pytest.mark.parametrize("where", ["missing/r.json", "."])
def test_an_unwritable_path_is_an_input_error(tmp_path: Path, where: str) -> None:
    with pytest.raises(InputError, match="cannot write"):
        write_result(full_result(), tmp_path / where)


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_numbers_that_are_not_finite_are_never_written(tmp_path: Path, bad: float) -> None:
    result = dataclasses.replace(full_result(), transforms=(TransformEstimate("a", "b", np.full((4, 4), bad)),))
    with pytest.raises(InputError, match=r"result\.transforms\[0\]\.matrix\[0\]\[0\] is (nan|inf)"):
        write_result(result, tmp_path / "r.json")
    assert not list(tmp_path.iterdir())


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "real.json").write_text("old")
    (tmp_path / "link.json").symlink_to(tmp_path / "real.json")
    write_result(full_result(), tmp_path / "link.json", force=True)
    assert (tmp_path / "link.json").is_symlink()
    assert read_result(tmp_path / "real.json").kind == "hand-eye"


HEAD = '"format": "calibrant/2", "kind": "x", "version": "1", "created": "t", "verdict": "ok"'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{\n oops", r"r\.json:2: not JSON"),
        ("[1]", "not a calibrant file"),
        ('{"kind": "x"}', "key 'format'"),
        ('{"format": "calibrant/3"}', r"'calibrant/3'.*reads 'calibrant/2' and 'calibrant/1': update"),
        ('{"format": "calibrant/2", "kind": "x", "verdict": "ok"}', "no key 'created'"),
        ('{"format": "calibrant/2", "kind": "x", "verdict": "good"}', "verdict is 'good'"),
        (f'{{{HEAD}, "rms_px": "big"}}', r'rms_px is "big", expected a number'),
        (f'{{{HEAD}, "rms_px": NaN}}', "holds NaN"),
        (f'{{{HEAD}, "transforms": [{{"parent": "a", "child": "b"}}]}}', r"transforms\[0\] has no key 'matrix'"),
        (f'{{{HEAD}, "transforms": [3]}}', r"transforms\[0\] is 3, expected an object"),
        (f'{{{HEAD}, "transforms": [{{"parent": "a", "child": "b", "matrix": [[1]]}}]}}', r"shape \(1, 1\).*\(4, 4\)"),
        (f'{{{HEAD}, "cameras": {{"c": {{"model": "brown"}}}}}}', r"cameras\.c has no key 'parameters'"),
        (f'{{{HEAD}, "views": [{{"id": "a", "used": 1, "points": 3}}]}}', "used is 1, expected true or false"),
        (f'{{{HEAD}, "views": [{{"id": "a", "used": true, "points": true}}]}}', "points is true, expected an integer"),
        (f'{{{HEAD}, "figures": {{"a": {{"sigma": 1}}}}}}', r"figures\.a has no key 'value'"),
        (f'{{{HEAD}, "figures": {{"a": {{"value": true}}}}}}', r"figures\.a\.value is true, expected a number"),
        (f'{{{HEAD}, "decided": {{"a": 3}}}}', r"decided\.a is 3, expected text"),
        (f'{{{HEAD}, "cell": {{"pictures": [{{"camera": "a"}}]}}}}', r"cell\.pictures\[0\] has no key 'robot'"),
        (f'{{{HEAD}, "details": {{"x": {{}}}}}}', "details has the key 'x'; expected: robot_parameters"),
        (f'{{{HEAD}, "details": {{"joint_axes": {{"axes": 3}}}}}}', r"joint_axes\.axes is 3, expected a list"),
        (f'{{{HEAD}, "details": {{"faults": {{"found": [], "b": 1}}}}}}', "faults has the key 'b'; expected: found"),
        (f'{{{HEAD}, "details": {{"valid_region": {{"x": 0.5}}}}}}', "valid_region has no key 'y'"),
        (
            f'{{{HEAD}, "details": {{"touched_point": {{"point_mm": [1, 2], "off_mm": {{}}}}}}}}',
            r"\[1, 2\], expected 3",
        ),
    ],
)
def test_what_is_not_a_result_is_said(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "r.json"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_result(path)
    assert str(path) in str(caught.value)


def test_a_missing_or_binary_file_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        read_result(tmp_path / "none.json")
    (tmp_path / "b.json").write_bytes(b"\xff\xd8\x00\x01")
    with pytest.raises(InputError, match="is a binary file"):
        read_result(tmp_path / "b.json")
