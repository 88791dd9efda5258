"""The text of a project: what was written is read, for ever, and what is none is refused by name."""

from __future__ import annotations

from dataclasses import replace

import pytest

from calibrant.errors import InputError
from calibrant.formats.projects.checks import check_name
from calibrant.formats.projects.edits import placed, with_component, with_seen
from calibrant.formats.projects.records import TYPED, Component, Entry, Kept, Notation, Placement, Project, Seen
from calibrant.formats.projects.text import NUMBER, parse_project, project_text

FORMAT_ONE = """\
# A calibrant project; see docs/project.md. Edited by hand it stays readable: leave the last line as it is.
format: calibrant-project/1
created: '2026-11-30T12:53:06+00:00'
version: 0.1.0
world: base
components:
  ur: {kind: robot, accuracy: '0.1mm,0.02deg'}
  left:
    kind: camera
    pose:
      relative_to: base
      xyz_mm: [1.5, -20, 900.25]
      ypr_deg: [10.0, 0.0, 180.0]
      source: typed in
    model: kannala_brandt
  eyes: {kind: rig, cameras: [left]}
  light: {kind: projector, camera: left, size: [1024, 768]}
  board: {kind: target, spec: 'chessboard:9x6:25mm'}
observations:
  hand:
    camera: left
    target: board
    setup: eye-in-hand
    images: [photos/*.png]
    robot: ur
    poses: [poses.csv]
    notation: {units: mm}
options: {fix: [k3]}
results:
- {of: cell, name: hand, file: results/cell-0123456789abcdef.json, sha256: aa, key: bb, made: now, robots: [ur]}
journal:
- {at: '2026-11-30T12:53:06+00:00', command: calibrant project new}
...
"""


def project() -> Project:
    out = Project(created="then", world="base")
    for name, component in {
        "ur": Component(kind="robot", accuracy="0.1mm,0.02deg"),
        "left": Component(kind="camera", model="kannala_brandt"),
        "eyes": Component(kind="rig", cameras=("left",)),
        "light": Component(kind="projector", camera="left", size=(1024, 768)),
        "board": Component(kind="target", spec="chessboard:9x6:25mm"),
    }.items():
        out = with_component(out, name, component)
    seen = Seen(camera="left", target="board", setup="eye-in-hand", images=("photos/*.png",), robot="ur",
                poses=("poses.csv",), notation=Notation(units="mm"))  # fmt: skip
    out = with_seen(out, "hand", seen)
    pose = Placement(relative_to="base", xyz_mm=(0.1, -1 / 3, 1e-7), ypr_deg=(10.0, 1 / 7, 180.0), source=TYPED)
    kept = Kept(of="cell", name="hand", file="results/cell-0123456789abcdef.json", sha256="aa", robots=("ur",))
    return replace(placed(out, "left", pose), results=(kept,), journal=(Entry(at="now", command="calibrant …"),))


def test_what_is_written_is_read() -> None:
    assert parse_project(project_text(project()), "file") == project()


def test_a_project_of_format_one_is_read_as_it_was_meant() -> None:
    found = parse_project(FORMAT_ONE, "file")
    assert found.components["left"].pose == Placement(
        relative_to="base", xyz_mm=(1.5, -20.0, 900.25), ypr_deg=(10.0, 0.0, 180.0), source=TYPED
    )
    assert found.observations["hand"].notation.units == "mm"
    assert found.options.fix == ("k3",)
    assert found.results[0].robots == ("ur",)
    assert parse_project(project_text(found), "file") == found


@pytest.mark.parametrize("end", range(0, len(FORMAT_ONE) - 4, 7))
def test_a_file_that_was_cut_off_anywhere_is_refused(end: int) -> None:
    with pytest.raises(InputError, match=r"^cell/calibrant\.yaml: "):
        parse_project(FORMAT_ONE[:end], "cell/calibrant.yaml")


def test_what_was_cut_between_two_lines_is_said_so() -> None:
    with pytest.raises(InputError, match="was cut off"):
        parse_project(FORMAT_ONE.removesuffix("...\n"), "file")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("project/1", f"project/{NUMBER + 1}", "of a newer calibrant"),
        ("calibrant-project/1", "calibrant/2", "not a project"),
        ("world: base", "world: nowhere", "no component called 'nowhere'"),
        ("kind: robot, accuracy", "kind: robot, colour: red, accuracy", "has the key 'colour'"),
        ("kind: rig", "kind: fleet", "no kind of component is called 'fleet'"),
        ("camera: left\n    target", "camera: right\n    target", "no camera called 'right'; cameras: left"),
        ("robot: ur", "robot: board", "'board' is a target"),
        ("900.25", ".nan", "not finite"),
        ("900.25", "high", "expected a number"),
        ("[1.5, -20, 900.25]", "[1.5, -20]", "has 2 numbers xyz_mm"),
        ("results/cell", "../cell", "expected one in the project's folder results"),
        ("  ur:", "  'no:\\u200b':", "U\\+200B|holds"),
        ("  ur:", "  yes:", "calls|no robot called 'ur'|quote it"),
        ("world: base", "world: &a [*a]", "alias|anchor|turn|itself|unfold|stands in"),
    ],
)  # fmt: skip
def test_what_is_no_project_is_said(old: str, new: str, said: str) -> None:
    assert old in FORMAT_ONE
    with pytest.raises(InputError, match=said):
        parse_project(FORMAT_ONE.replace(old, new), "file")


@pytest.mark.parametrize(
    "name", ["Kamera Ö", "<script>alert(1)</script>", "../../etc/passwd", "1", "true", "相机", "[b]"]
)
def test_strange_names_come_back(name: str) -> None:
    made = with_component(Project(), name, Component(kind="camera"))
    assert list(parse_project(project_text(made), "file").components) == [name]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("", "empty"),
        (" left", "blank"),
        ("left\n", "blank"),
        ("le\0ft", "not seen"),
        ("le\u202eft", r"U\+202E"),
        ("-left", "begins with -"),
        ("a=b", "'='"),
        ("a:b", "':'"),
        ("x" * 101, "101 letters"),
    ],
)
def test_names_that_no_command_could_say_are_refused(name: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        check_name(name)


def test_accents_have_one_form() -> None:
    assert check_name("e\u0301") == check_name("é")
