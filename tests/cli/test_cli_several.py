"""`calibrant hand-eye` with several cameras, several robots, and free joints."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

import calibrant as cb
from calibrant.data.details import RobotParameters
from calibrant.data.typed_json import as_json
from calibrant.geometry import se3, so3
from calibrant.robots.arms import arm
from calibrant.robots.inverse import solve_inverse
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import gripper_poses, look_at_board, standard_mounting
from calibrant.simulate.truth import normalised
from calibrant.targets.registry import parse_target

TARGET = "chessboard:7x6:30mm"
VIEWS = 8
T_LEFT_RIGHT = se3.make(so3.exp([0.0, -0.05, 0.02]), [0.05, 0.0, 0.0])
OFFSETS_DEG = np.array([0.0, 0.5, -0.6, 0.4, -0.5, 0.0])


@dataclass(frozen=True)
class Pair:
    """The cell's photos, and those of a second camera on the same gripper under names of its own."""

    left: Path
    right: Path
    poses: Path
    joints: Path


@pytest.fixture(scope="session")
def pair(cell, tmp_path_factory: pytest.TempPathFactory) -> Pair:
    folder = tmp_path_factory.mktemp("pair")
    right = folder / "right"
    right.mkdir()
    target = parse_target(TARGET)
    X, Z = standard_mounting("eye-in-hand")
    # The cell's own true views: its robot's poses carry noise, which both cameras share.
    seen = look_at_board(
        cell.camera, target.points, VIEWS, rng=np.random.default_rng(7), distance=(0.35, 0.6), tilt_deg=45
    )
    rng = np.random.default_rng(11)
    names = [row.split(",")[0] for row in cell.poses.read_text().splitlines()[1:]]
    for name, B in zip(names, seen):
        there = se3.inverse(T_LEFT_RIGHT) @ B
        image = render(target.artwork(), cell.camera, there, rng=rng, look=Look(clutter=0, noise_grey=2.0))
        cv2.imwrite(str(right / name), image)
    read = np.rad2deg([_joints(T, rng) for T in gripper_poses("eye-in-hand", X, Z, seen)]) - OFFSETS_DEG
    joints = folder / "joints.csv"
    lines = [",".join([name, *(f"{v:.6f}" for v in q)]) for name, q in zip(names, read)]
    joints.write_text("\n".join(["image,q1,q2,q3,q4,q5,q6", *lines]) + "\n")
    return Pair(cell.images, right, cell.poses, joints)


def _joints(T_base_gripper: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Joints of an arm that reach the pose, from the first of many starts that leads there."""
    starts = rng.uniform(-np.pi, np.pi, (60, 6))
    found = solve_inverse(arm("ur10e"), np.tile(T_base_gripper, (60, 1, 1)), starts)
    return found.q[int(np.flatnonzero(found.reached)[0])]


def test_two_cameras_by_name(calibrant, pair: Pair, cell, tmp_path: Path) -> None:
    out, page = tmp_path / "result.json", tmp_path / "result.html"
    outcome = calibrant(
        "hand-eye", "--images", f"left={pair.left}", "--images", f"right={pair.right}/*.png", "--poses", pair.poses,
        "--target", TARGET, "--out", out, "--report", page, "--workspace", "300mm:500mm,-100mm:100mm,0mm:50mm",
        "--tolerance", "50mm",
    )  # fmt: skip
    assert (outcome.status, outcome.err) == (0, "")
    result = cb.read(out)
    assert {(t.parent, t.child) for t in result.transforms} == {
        ("gripper", "left"), ("gripper", "right"), ("base", "target"), ("left", "right"),
    }  # fmt: skip
    between = result.transform("left", "right")
    # sqrt of chi-square(6) / 6 is below 2 in all but 1 in 2000 cases.
    assert np.sqrt(normalised(between, T_LEFT_RIGHT) / 6) < 2
    assert result.joint_covariance is not None
    assert "T_left_right" in outcome.out
    text = page.read_text()
    assert "In the workspace: left" in text
    assert "Target as each camera sees it" in text
    assert {result.check(f"workspace-{c}").status for c in ("left", "right")} == {"ok"}
    assert {"left: park", "left: joint", "right: mean"} <= set(result.methods)
    assert result.target_scale is not None
    # A board at its true size, by some 8 poses with the cell's noise: within 4 sigma.
    assert abs(result.target_scale.value - 1) < 4 * result.target_scale.sigma
    # A tolerance that cannot be met: status 1 and both cameras told, from the file alone.
    again = calibrant("report", out, "--workspace", "300mm:500mm,-100mm:100mm,0mm:50mm", "--tolerance", "0.001mm")
    assert again.status == 1
    assert "NOT within the tolerance" in again.err


def test_a_camera_with_one_photo_is_placed_by_what_the_other_found(calibrant, pair: Pair, cell, tmp_path: Path) -> None:
    photo, lens, out = sorted(pair.right.iterdir())[3], tmp_path / "lens.json", tmp_path / "result.json"
    camera = cell.camera
    lens.write_text(json.dumps({"image_size": camera.image_size, "model": "brown", "parameters": camera.parameters}))
    given = (
        "hand-eye", "--images", f"left={pair.left}", "--images", f"right={photo}", "--poses", pair.poses,
        "--target", TARGET, "--camera", f"left={lens}", "--camera", f"right={lens}",
    )  # fmt: skip
    outcome = calibrant(*given, "--setup", "right=eye-in-hand", "--out", out)
    assert outcome.status == 0, outcome.err
    between = cb.read(out).transform("left", "right")
    assert np.sqrt(normalised(between, T_LEFT_RIGHT) / 6) < 2
    refused = calibrant(*given)
    assert refused.status == 1
    assert "right: 1 photo shows the target" in refused.err
    assert "--setup right=eye-in-hand" in refused.err


def test_free_joints_from_joint_values(calibrant, pair: Pair, cell, tmp_path: Path) -> None:
    out = tmp_path / "result.json"
    outcome = calibrant(
        "hand-eye", "--images", f"left={pair.left}", "--images", f"right={pair.right}", "--poses", pair.joints,
        "--target", TARGET, "--robot", "ur10e", "--identify", "offsets", "--out", out, "-q",
    )  # fmt: skip
    assert (outcome.status, outcome.out) == (0, "")
    rows = {p.name: as_json(p) for p in cb.read(out).detail(RobotParameters).robots["robot"]}
    for name, truth in zip(("shoulder_lift", "elbow", "wrist_1", "wrist_2"), OFFSETS_DEG[1:5]):
        row = rows[f"{name} offset"]
        assert abs(row["correction"] - np.deg2rad(truth)) < 4 * row["sigma"]
    assert "sigma" not in rows["shoulder_pan offset"]


def test_copied_photos_are_refused_before_they_are_searched(calibrant, pair: Pair, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(pair.left, copy)
    outcome = calibrant(
        "hand-eye", "--images", f"left={pair.left}", "--images", f"right={copy}", "--poses", pair.poses,
        "--target", "chessboard:3x3:10mm",
    )  # fmt: skip
    assert outcome.status == 2
    assert "are one photo, byte by byte" in outcome.err
    assert " of left and " in outcome.err
    assert " of right " in outcome.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--images", "left={left}", "--images", "{right}"), "has no name"),
        (("--images", "{left}", "--camera", "left=camera.json"), "the photos have no names"),
        (("--images", "left={left}", "--camera", "top=camera.json"), "there is no camera of that name"),
        (("--images", "left@a={left}"), "robot 'a', which has no poses; --poses names none"),
        (("--images", "left={left}", "--images", "right={left}"), "is a photo of left and of right"),
        (("--images", "left@a:b={left}"), "robot 'a' has no poses"),
        (("--images", "left={left}", "--setup", "left=eye-in-foot"), "unknown setup"),
        (("--images", "left={left}", "--identify", "offsets"), "--identify needs the joints"),
        (
            ("--images", "left={left}", "--identify", "offsets", "--workspace", "0mm:1mm,0mm:1mm,0mm:1mm"),
            "not available with --identify",
        ),
        (("--images", "left={left}", "--tolerance", "1mm"), "--workspace"),
    ],
)
def test_what_does_not_fit_together_is_said(calibrant, pair: Pair, arguments: tuple[str, ...], words: str) -> None:
    given = [a.format(left=pair.left, right=pair.right) for a in arguments]
    outcome = calibrant("hand-eye", *given, "--poses", pair.poses, "--target", TARGET)
    assert outcome.status == 2
    assert words in outcome.err
    assert outcome.out == ""
