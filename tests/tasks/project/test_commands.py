"""The commands about projects: what they print, write and refuse, from the command line and from Python."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.cli.application import run
from calibrant.formats.exchange.read import read_any
from calibrant.formats.projects.folder import read_project
from calibrant.geometry import rotations, se3, so3

K = np.array([[1200.5, 0.0, 639.25], [0.0, 1199.125, 479.75], [0.0, 0.0, 1.0]])
KC = [-0.11, 0.087, 0.0003, -0.0002, 0.01]
T_LEFT_WORLD = se3.make(so3.exp([0.3, -0.2, 0.1]), [0.0123456789, -0.2, 0.9])
T_RIGHT_WORLD = se3.make(so3.exp([0.25, 0.4, -0.3]), [0.31, 0.0567891234, 1.1])


def easycalib(folder: Path, first: int, world: str = "Table") -> Path:
    """A project of two cameras and a table, as the manual has it (4.1 to 4.3): X_C = R X_W + T, millimetres."""
    lines = ["%YAML:1.0", "---", 'ISODate: "2024-05-01T10:00:00"', "Sensors: [ Left, Right, Table ]", f"World: {world}"]
    for k, T in enumerate((T_LEFT_WORLD, T_RIGHT_WORLD, np.eye(4)), first):
        if k < first + 2:
            lines += [*matrix(f"K_{k}", K), *matrix(f"kc_{k}", np.array([KC]).T)]
        lines += [*matrix(f"R_{k}", T[:3, :3]), *matrix(f"T_{k}", 1e3 * T[:3, 3:])]
    file = folder / f"project{first}.yml"
    file.write_text("\n".join(lines) + "\n")
    return file


def matrix(name: str, values: np.ndarray) -> list[str]:
    data = ", ".join(f"{v:.15e}" for v in values.ravel())
    return [f"{name}: !!opencv-matrix", f"   rows: {values.shape[0]}", f"   cols: {values.shape[1]}", "   dt: d",
            f"   data: [ {data} ]"]  # fmt: skip


def said(*words: object) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = run([str(w) for w in words])
    return status, out.getvalue(), err.getvalue()


def project(folder: Path) -> Path:
    """A robot, a camera and a table."""
    cell = folder / "cell"
    cb.project_new(cell)
    cb.project_add("robot", "ur", project=cell)
    cb.project_add("camera", "top", project=cell)
    cb.project_add("frame", "table", project=cell)
    return cell


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("first", [0, 1])
def test_a_project_of_the_manual_keeps_its_numbers_in_another_world(tmp_path: Path, first: int) -> None:
    """Read, the world changed to a camera, written, read again: against the manual's equation, X_C = R X_W + T."""
    cell, out = tmp_path / "cell", tmp_path / "again.yml"
    cb.project_new(cell, from_=easycalib(tmp_path, first))
    cb.project_set("Right", project=cell, world=True)
    status, _, error = said("convert", cell, out, "--to", "easycalib", "--choose", f"index={first}")
    assert status == 0, error
    data = read_any(out, form="easycalib")
    assert f"World: {'Right'}" in out.read_text().replace('"', "")
    # With the right camera as the world, the left sees X_L = R_L R_R^T X_R + t_L - R_L R_R^T t_R, the table X_T = …
    R = T_LEFT_WORLD[:3, :3] @ T_RIGHT_WORLD[:3, :3].T
    t = T_LEFT_WORLD[:3, 3] - R @ T_RIGHT_WORLD[:3, 3]
    T_left_right = se3.inverse(data.transform("Right", "Left").matrix)
    np.testing.assert_allclose(T_left_right[:3, :3], R, atol=1e-9)
    np.testing.assert_allclose(1e3 * T_left_right[:3, 3], 1e3 * t, atol=1e-9)
    np.testing.assert_allclose(data.transform("Right", "Table").matrix, T_RIGHT_WORLD, atol=1e-12)
    for camera in ("Left", "Right"):
        np.testing.assert_allclose(data.cameras[camera].K, K, rtol=0, atol=1e-9)
        found = [data.cameras[camera].parameters[n] for n in ("k1", "k2", "p1", "p2", "k3")]
        np.testing.assert_allclose(found, KC, atol=1e-12)
    back = tmp_path / "back"
    cb.project_new(back, from_=out)
    cb.project_set("Table", project=back, world=True)
    places = {p.name: p for p in cb.project_list(project=back).places}
    np.testing.assert_allclose(places["Left"].T, se3.inverse(T_LEFT_WORLD), atol=1e-12)


def test_what_a_file_does_not_say_is_said(tmp_path: Path) -> None:
    status, out, error = said("project", "new", tmp_path / "cell", "--from", easycalib(tmp_path, 0))
    assert status == 0
    assert "with Table, Left, Right" in out
    assert "X_camera = R X_world + T" in error
    assert "no image size" in error


def test_a_typed_pose_is_marked_has_no_sigma_and_survives(tmp_path: Path) -> None:
    cell = project(tmp_path)
    options = ("--relative-to", "base", "--xyz", "-12.5mm,0.2m,900mm", "--ypr", "10deg,-20deg,180deg")
    status, out, error = said("project", "set", "top", "--project", cell, *options)
    assert status == 0, error
    assert "-12.500, 200.000, 900.000" in out
    assert "10.0000, -20.0000, 180.0000" in out
    assert "typed in" in out
    assert "±" not in out
    pose = read_project(cell).components["top"].pose
    assert pose is not None
    assert (pose.xyz_mm, pose.ypr_deg, pose.source) == ((-12.5, 200.0, 900.0), (10.0, -20.0, 180.0), "typed in")
    _, text, _ = said("project", "list", "--project", cell, "--relative-to", "top", "--json")
    places = {p["name"]: p for p in json.loads(text)["places"]}
    R = rotations.matrix_from_yaw_pitch_roll([10.0, -20.0, 180.0], unit="deg")
    np.testing.assert_allclose(places["ur"]["xyz_mm"], -R.T @ [-12.5, 200.0, 900.0], atol=1e-9)
    assert places["ur"]["source"] == "typed in"
    assert "sigma_mm" not in places["ur"]
    assert places["table"]["source"] == "not known"


def test_a_pose_is_shown_in_another_frame_without_moving(tmp_path: Path) -> None:
    cell = project(tmp_path)
    cb.project_set("top", project=cell, relative_to="base", xyz="0mm,0mm,900mm", ypr="30deg,0deg,180deg")
    cb.project_set("table", project=cell, relative_to="base", xyz="500mm,10mm,-3mm", ypr="0deg,90deg,1deg")
    before = {p.name: p.T for p in cb.project_list(project=cell, relative_to="base").places}
    moved = cb.project_set("top", project=cell, relative_to="table")
    assert moved.components["top"].pose.relative_to == "table"
    after = {p.name: p for p in cb.project_list(project=cell).places}
    assert (after["top"].relative_to, after["top"].source) == ("table", "typed in")
    np.testing.assert_allclose(
        {p.name: p for p in cb.project_list(project=cell, relative_to="base").places}["top"].T,
        before["top"],
        atol=1e-12,
    )
    cb.project_set("top", project=cell, forget=True)
    assert read_project(cell).components["top"].pose is None


def test_the_journal_holds_the_commands_as_they_were_given(tmp_path: Path) -> None:
    cell = project(tmp_path)
    said("project", "set", "top", "--project", cell, "--relative-to", "base", "--xyz", "1mm,2mm,3mm")
    said("project", "rename", "top", "my top", "--project", cell)
    said("project", "remove", "table", "--project", cell)
    assert [e.command for e in read_project(cell).journal] == [
        "calibrant project new",
        "calibrant project add robot ur",
        "calibrant project add camera top",
        "calibrant project add frame table",
        "calibrant project set top --relative-to base --xyz 1mm,2mm,3mm",
        "calibrant project rename top 'my top'",
        "calibrant project remove table",
    ]


@pytest.mark.parametrize(
    ("words", "status", "message"),
    [
        (("set", "nobody", "--world"), 2, "no component called 'nobody'; there are: ur, top, table, ur_gripper, base"),
        (("set", "top", "--relative-to", "hall", "--xyz", "1mm,2mm,3mm"), 2, "no component called 'hall'"),
        (("set", "top", "--relative-to", "base", "--xyz", "1,2,3"), 2, "'1' has no unit"),
        (("set", "top", "--relative-to", "base", "--xyz", "1mm,2mm"), 2, "takes three values"),
        (("set", "top", "--xyz", "1mm,2mm,3mm"), 2, "name it with --relative-to"),
        (("set", "top"), 2, "say one thing"),
        (("list", "--relative-to", "hall"), 2, "no component called 'hall'; there are"),
        (("remove", "hall"), 2, "no component called 'hall'"),
        (("rename", "top", "ur"), 2, "a robot called 'ur' already"),
        (("rename", "top", "a\u202eb"), 2, "U+202E"),
        (("add", "camera", "top"), 2, "a camera called 'top' already"),
        (("add", "camera", "a=b"), 2, "'='"),
        (("add", "lamp", "l"), 2, "no kind is called 'lamp'"),
        (("add", "robot", "r", "--spec", "x"), 2, "--spec is nothing that a robot has; it takes --accuracy"),
        (("add", "target", "t"), 2, "needs its --spec"),
        (("add", "camera", "c", "--file", "none.yml"), 2, "none.yml does not exist"),
        (("add", "camera", "c", "--model", "fishy"), 2, "no camera model is called 'fishy'"),
        (("add", "images", "i", "--camera", "side", "--images", "x"), 2, "no camera called 'side'; cameras: top"),
        (("add", "images", "i", "--camera", "top", "--images", "x"), 2, "the target they show"),
        (("solve",), 2, "no observations"),
    ],
)
def test_what_cannot_be_done_is_said(tmp_path: Path, words: tuple[str, ...], status: int, message: str) -> None:
    cell = project(tmp_path)
    before = (cell / "calibrant.yaml").read_bytes()
    found, _, error = said("project", *words, "--project", cell)
    assert found == status, error
    assert message in error
    assert (cell / "calibrant.yaml").read_bytes() == before


def test_images_that_are_gone_are_named_and_the_rest_can_be_read(tmp_path: Path) -> None:
    cell = project(tmp_path)
    photos = cell / "photos"
    photos.mkdir()
    (photos / "1.png").write_bytes(b"")
    cb.project_add("target", "board", project=cell, spec="chessboard:9x6:25mm")
    cb.project_add("images", "front", project=cell, camera="top", target="board", images=photos)
    assert read_project(cell).observations["front"].images == ("photos",)
    (photos / "1.png").unlink()
    photos.rmdir()
    for command in ("solve", "check"):
        status, _, error = said("project", command, "--project", cell)
        assert status == 2
        assert "observations front" in error
        assert "photos" in error
    status, out, _ = said("project", "status", "--project", cell)
    assert status == 0
    assert "cannot be solved" in out
    assert said("project", "list", "--project", cell)[0] == 0


def test_where_there_is_no_project_is_said(tmp_path: Path) -> None:
    status, _, error = said("project", "list", "--project", tmp_path)
    assert status == 2
    assert "calibrant project new" in error


def test_strange_names_are_shown_as_they_are(tmp_path: Path) -> None:
    cell = project(tmp_path)
    for name in ("[red]b[/]", "<b>x</b>", "相機 1"):
        assert said("project", "add", "camera", name, "--project", cell)[0] == 0
        assert name in said("project", "list", "--project", cell)[1]
