"""Conventions decided by data: synthetic cells in both setups, real pose pairs written in every wrong way."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant.diagnose.conventions.decide import Setup, decide, rank, robot_side
from calibrant.diagnose.conventions.hypotheses import SETUPS
from calibrant.errors import InputError, RefusedError
from calibrant.formats.poses.read import PoseNotation, every_notation, notations, read_poses
from calibrant.geometry import rotations, se3, so3

Array = NDArray[np.float64]
X = se3.make(so3.exp([0.3, -1.2, 0.5]), [0.06, -0.03, 0.09])
Z = se3.make(so3.exp([2.9, 0.4, -0.2]), [0.5, 0.2, 0.1])


def mounting(setup: Setup) -> tuple[Array, Array]:
    """X and Z of a cell as people build it: what the gripper carries is near it, the other stands apart."""
    return (X, Z) if setup == "eye-in-hand" else (se3.inverse(Z), se3.inverse(X))


def cell(n: int, *, setup: Setup, noise: float, seed: int = 0) -> tuple[Array, Array]:
    """T_base_gripper and T_camera_target of n poses that turn by some 30 degrees; noise times 0.1 mm, 0.02 deg."""
    rng = np.random.default_rng(seed)
    centre = se3.make(so3.exp([3.0, 0.3, 0.2]), [0.5, 0.1, 0.6])
    delta = np.concatenate([rng.normal(0, 0.5, (n, 3)), rng.normal(0, 0.12, (n, 3))], axis=1)
    T_base_gripper = se3.retract(np.broadcast_to(centre, (n, 4, 4)), delta)
    # A X B = Z gives B = X^-1 A^-1 Z.
    X_setup, Z_setup = mounting(setup)
    B = se3.inverse(X_setup) @ se3.inverse(robot_side(T_base_gripper, setup)) @ Z_setup
    shake = rng.normal(size=(n, 6)) * [*[np.deg2rad(0.02)] * 3, *[1e-4] * 3]
    return T_base_gripper, se3.retract(B, noise * shake)


def written(folder: Path, header: str, position: Array, numbers: Array) -> tuple[PoseNotation, ...]:
    path = folder / "poses.csv"
    rows = "\n".join(",".join(repr(float(v)) for v in row) for row in np.column_stack([position, numbers]))
    path.write_text(f"{header}\n{rows}\n")
    return notations(read_poses(path))


def native(folder: Path, T: Array) -> tuple[PoseNotation, ...]:
    return written(folder, "x,y,z,qx,qy,qz,qw", T[:, :3, 3], rotations.quaternion_xyzw_from_matrix(T[:, :3, :3]))


def some(found: Sequence[PoseNotation], index: Array) -> list[PoseNotation]:
    """The notations of some of the poses, in another order if need be."""
    ids = tuple(str(i) for i in range(len(index)))
    return [replace(r, ids=ids, T_base_gripper=r.T_base_gripper[index]) for r in found]


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_clean_native_poses_are_read_as_they_are_and_the_setup_is_found(
    tmp_path: Path, setup: Setup, noise: float
) -> None:
    T, B = cell(12, setup=setup, noise=noise)
    decision = decide(native(tmp_path, T), B)
    assert (decision.setup, decision.notation.direction, decision.notation.rotation) == (
        setup,
        "base-gripper",
        "quat-xyzw",
    )
    assert decision.findings == ()
    assert decision.confidence > 0.999
    np.testing.assert_allclose(decision.notation.poses.T_base_gripper, T, atol=1e-12)


def test_the_message_says_what_no_data_can_tell(tmp_path: Path) -> None:
    T, B = cell(12, setup="eye-in-hand", noise=1)
    message = decide(native(tmp_path, T), B).message
    assert (
        "poses read as positions in m, quaternions x y z w, T_base_gripper, eye-in-hand: the loop closes to" in message
    )
    assert "eye-to-hand with poses given as T_gripper_base would fit as well, but that puts the target" in message
    assert "puts the target 0.55 m from the gripper and the camera 0.11 m from the base" in message


def test_inverted_poses_are_found_by_the_cell_they_would_make(tmp_path: Path) -> None:
    for setup in SETUPS:
        T, B = cell(12, setup=setup, noise=1)
        for asked in ("auto", setup):
            decision = decide(native(tmp_path, se3.inverse(T)), B, setup=asked)  # type: ignore[arg-type]
            assert (decision.setup, decision.notation.direction) == (setup, "gripper-base")
            assert [(f.name, f.status) for f in decision.findings] == [("pose-direction", "warn")]
            assert "which nobody builds" in decision.findings[0].message
            np.testing.assert_allclose(decision.notation.T_base_gripper, T, atol=1e-12)


def test_a_cell_that_could_be_either_keeps_the_documented_direction(tmp_path: Path) -> None:
    T, B = cell(12, setup="eye-in-hand", noise=1)
    near = se3.make(np.eye(3), [-0.25, 0.0, 0.0])  # the target 0.33 m from the base: a gripper could carry it
    decision = decide(native(tmp_path, near @ T), B)
    assert (decision.setup, decision.notation.direction, decision.findings) == ("eye-in-hand", "base-gripper", ())
    assert "the documented direction was taken" in decision.message
    assert "--pose-direction gripper-base" in decision.message


def test_a_given_direction_settles_the_setup(tmp_path: Path) -> None:
    T, B = cell(12, setup="eye-in-hand", noise=1)
    inverted = [r for r in native(tmp_path, se3.inverse(T)) if r.direction == "gripper-base"]
    decision = decide(inverted, B)
    assert decision.setup == "eye-in-hand"
    np.testing.assert_allclose(decision.notation.T_base_gripper, T, atol=1e-12)


def layouts(T: Array) -> dict[str, tuple[str, Array, Array]]:
    """Ways to write the same poses: header, positions, rotations."""
    t, R = T[:, :3, 3], T[:, :3, :3]
    q = rotations.quaternion_xyzw_from_matrix(R)
    degrees = {o: rotations.euler_from_matrix(R, order=o, unit="deg") for o in ("ZYX", "xyz", "XYZ", "ZYZ")}
    return {
        "scalar first under the native header": ("x,y,z,qx,qy,qz,qw", t, np.roll(q, 1, axis=1)),
        "numbered quaternions": ("x,y,z,q0,q1,q2,q3", t, q),
        "millimetres": ("x,y,z,qx,qy,qz,qw", 1e3 * t, q),
        "millimetres under a header that says metres": ("x[m],y[m],z[m],qx,qy,qz,qw", 1e3 * t, q),
        "metres under a header that says millimetres": ("x[mm],y[mm],z[mm],qx,qy,qz,qw", t, q),
        "ZYX under rx ry rz": ("x,y,z,rx,ry,rz", t, degrees["ZYX"]),
        "ZYX by name": ("x,y,z,rz,ry,rx", t, degrees["ZYX"]),
        "fixed xyz": ("x,y,z,rx,ry,rz", t, degrees["xyz"]),
        "moving XYZ": ("x,y,z,rx,ry,rz", t, degrees["XYZ"]),
        "ZYZ": ("x,y,z,e1,e2,e3", t, degrees["ZYZ"]),
        "rotation vector": ("x,y,z,rx,ry,rz", t, so3.log(R)),
        "radians and millimetres": ("x,y,z,roll,pitch,yaw", 1e3 * t, np.deg2rad(degrees["xyz"])),
        "yaw first under roll pitch yaw": ("x,y,z,roll,pitch,yaw", t, degrees["ZYX"]),
        "KUKA": ("X,Y,Z,A,B,C", 1e3 * t, degrees["ZYX"]),
    }


OVERRULED = {
    "scalar first under the native header",
    "millimetres under a header that says metres",
    "metres under a header that says millimetres",
    "ZYX under rx ry rz",
    "yaw first under roll pitch yaw",
}


@pytest.mark.parametrize("layout", list(layouts(np.eye(4)[None])))
def test_every_way_of_writing_is_found_out(tmp_path: Path, layout: str) -> None:
    T, B = cell(12, setup="eye-in-hand", noise=1)
    decision = decide(written(tmp_path, *layouts(T)[layout]), B)
    np.testing.assert_allclose(decision.notation.T_base_gripper, T, atol=1e-12)
    assert [f.name for f in decision.findings] == (["header-overruled"] if layout in OVERRULED else [])
    if layout in OVERRULED:
        assert decision.findings[0].status == "warn"
        assert "that is used" in decision.findings[0].message


@pytest.mark.parametrize("layout", list(layouts(np.eye(4)[None])))
def test_real_poses_written_in_every_way_are_found_out(
    shared_data: Callable[[str], Path], tmp_path: Path, layout: str
) -> None:
    raw = read_poses(shared_data("handeye_moveit_poses") / "pose_samples.json")
    assert raw.target is not None
    T, B = notations(raw)[0].T_base_gripper[::4], notations(raw.target)[0].T_base_gripper[::4]
    decision = decide(written(tmp_path, *layouts(T)[layout]), B)
    assert decision.setup == "eye-to-hand"
    np.testing.assert_allclose(decision.notation.T_base_gripper, T, atol=1e-12)


def test_the_wrong_setup_is_a_finding_with_both_loops(shared_data: Callable[[str], Path]) -> None:
    raw = read_poses(shared_data("handeye_moveit_poses") / "pose_samples.json")
    assert raw.target is not None
    B = notations(raw.target)[0].T_base_gripper
    for found in (notations(raw), notations(raw, direction="base-gripper")):
        decision = decide(found, B, setup="eye-in-hand")
        finding = decision.findings[0]
        assert (finding.name, finding.status, decision.ok) == ("setup-mismatch", "fail", False)
        # README of the set: 285-1130 mm as eye-in-hand, about 4.6 mm as eye-to-hand.
        assert "the data do not fit eye-in-hand: its loop leaves 2" in finding.message
        assert "that of eye-to-hand 3.97 mm / 0.079 deg; use --setup eye-to-hand" in finding.message
    right = decide(notations(raw), B, setup="eye-to-hand")
    assert right.ok
    assert right.findings == ()


def test_random_subsets_of_real_poses_raise_no_alarm(shared_data: Callable[[str], Path]) -> None:
    raw = read_poses(shared_data("handeye_moveit_poses") / "pose_samples.json")
    assert raw.target is not None
    B, found, rng = notations(raw.target)[0].T_base_gripper, notations(raw), np.random.default_rng(1)
    for n in rng.integers(4, 20, 20):
        index = rng.choice(50, n, replace=False)
        decision = decide(some(found, index), B[index])
        assert (decision.setup, decision.notation.direction, decision.findings) == ("eye-to-hand", "base-gripper", ())


@pytest.mark.parametrize("fault", ["flips", "swap"])
def test_a_few_wrong_views_do_not_hide_the_reading(tmp_path: Path, fault: str) -> None:
    T, B = cell(15, setup="eye-to-hand", noise=1)
    if fault == "flips":
        B[:3] = B[:3] @ np.diag([-1.0, -1.0, 1.0, 1.0])
    else:
        B[[4, 9]] = B[[9, 4]]
    decision = decide(written(tmp_path, *layouts(T)["ZYX under rx ry rz"]), B)
    assert decision.setup == "eye-to-hand"
    np.testing.assert_allclose(decision.notation.T_base_gripper, T, atol=1e-12)


def test_poses_paired_with_the_wrong_images_fit_no_reading(tmp_path: Path) -> None:
    T, B = cell(15, setup="eye-to-hand", noise=1)
    decision = decide(native(tmp_path, T), np.roll(B, 1, axis=0))
    assert decision.findings[-1].name == "no-reading-fits"
    assert not decision.ok
    assert decision.confidence < 0.99
    assert "are images and poses paired rightly" in decision.findings[-1].message


def test_three_poses_never_tell_the_setups_apart(tmp_path: Path) -> None:
    T, B = cell(3, setup="eye-in-hand", noise=0.3)
    with pytest.raises(RefusedError, match=r"fit equally well .*three poses never tell .*--setup eye-"):
        decide(native(tmp_path, T), B)
    assert decide([native(tmp_path, T)[0]], B, setup="eye-in-hand").setup == "eye-in-hand"


def test_readings_that_give_one_result_need_no_choice(tmp_path: Path) -> None:
    T, B = cell(8, setup="eye-in-hand", noise=1)
    one, *_ = native(tmp_path, T)
    twin = replace(one, rotation="matrix")
    assert decide([one, twin], B).notation.rotation == "quat-xyzw"


def test_degenerate_motions_are_refused_by_their_name(tmp_path: Path) -> None:
    T, _ = cell(8, setup="eye-in-hand", noise=0)
    T[:, :3, :3] = T[0, :3, :3]
    B = se3.inverse(X) @ se3.inverse(T) @ Z
    with pytest.raises(RefusedError, match="translations alone leave"):
        decide(native(tmp_path, T), B)
    T[:, :3, :3] = so3.exp(np.linspace(-0.6, 0.6, 8)[:, None] * [0.0, 0.0, 1.0]) @ T[:, :3, :3]
    with pytest.raises(RefusedError, match="parallel-axes"):
        decide(native(tmp_path, T), se3.inverse(X) @ se3.inverse(T) @ Z)
    with pytest.raises(RefusedError, match="hand-eye calibration needs at least 3"):
        decide(native(tmp_path, T[:2]), B[:2])


def test_numbers_of_poses_must_agree(tmp_path: Path) -> None:
    T, B = cell(8, setup="eye-in-hand", noise=0)
    with pytest.raises(InputError, match="8 robot poses but 7 target poses"):
        decide(native(tmp_path, T), B[:7])
    with pytest.raises(InputError, match="no reading of the robot poses"):
        rank([], B)


def bare(folder: Path, first: Array, second: Array, syntax: str) -> tuple[PoseNotation, ...]:
    """Rows of six bare numbers: one text, a text a pose, or lists in JSON."""
    rows = np.column_stack([first, second]).tolist()
    lines = [" ".join(repr(float(v)) for v in row) for row in rows]
    if syntax == "json":
        (folder / "poses.json").write_text(json.dumps(rows))
        return every_notation(read_poses(folder / "poses.json"))
    if syntax == "text":
        (folder / "poses.txt").write_text("\n".join(lines))
        return every_notation(read_poses(folder / "poses.txt"))
    for i, line in enumerate(lines):
        (folder / f"pos{i}.txt").write_text(line)
    return every_notation(read_poses([folder / f"pos{i}.txt" for i in range(len(rows))]))


@pytest.mark.parametrize(
    ("syntax", "unit", "form"),
    [("text", 1.0, "rotvec"), ("files", 250.0, "deg"), ("json", 250.0, "deg"), ("files", 1000.0, "deg")],
)
@pytest.mark.parametrize("first", ["position", "rotation"])
def test_the_order_of_six_bare_numbers_is_decided_by_the_loop(
    tmp_path: Path, syntax: str, unit: float, form: str, first: str
) -> None:
    T, B = cell(12, setup="eye-in-hand", noise=0.1)
    if unit == 250.0:  # millimetres of a small cell: no number past a full turn, so that either could be the angles
        T[:, :3, 3] *= 0.25
        B[:, :3, 3] *= 0.25
        unit = 1000.0
    R = T[:, :3, :3]
    angles = so3.log(R) if form == "rotvec" else rotations.euler_from_matrix(R, order="xyz", unit="deg")
    columns = (unit * T[:, :3, 3], angles)
    found = decide(bare(tmp_path, *(columns if first == "position" else columns[::-1]), syntax), B)
    np.testing.assert_allclose(found.notation.T_base_gripper, T, atol=1e-9)
    assert all(f.status == "ok" for f in found.findings)
    beyond = unit * np.abs(T[:, :3, 3]).max() > 360  # then the numbers tell by themselves
    asked = first == "rotation" and not beyond
    assert [f.name for f in found.findings] == (["rotation-first"] if asked else [])
    assert found.notation.rotation_first == asked
