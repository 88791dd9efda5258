"""Bundles and lists of points: geometry of their files, and what is wrong with bad ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.targets.bundle import Bundle
from calibrant.targets.registry import parse_target
from calibrant.targets.yaml_file import parse_yaml

CUBE = """
target: bundle
dictionary: 36h11
cubes:
  - side: 60mm
    marker: 48mm
    ids: [10, 11, 12, 13, null, 15]
    position: [0mm, 0mm, 100mm]
"""


def bundle(folder: Path, text: str) -> Bundle:
    """The bundle of a file with this text."""
    file = folder / "bundle.yaml"
    file.write_text(text)
    target = parse_target(str(file))
    assert isinstance(target, Bundle)
    return target


def test_a_cube_s_markers_lie_on_its_faces_and_look_outwards(tmp_path: Path) -> None:
    cube = bundle(tmp_path, CUBE)
    corners = cube.points.reshape(-1, 4, 3) - [0, 0, 0.1]
    assert [i for i, _ in cube.markers] == [10, 11, 12, 13, 15]
    outwards = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, -1]])
    np.testing.assert_allclose(corners.mean(axis=1), 0.03 * outwards, atol=1e-12)
    x, y = corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]
    # x to the right and y down, seen from outside: their product points into the face.
    np.testing.assert_allclose(np.cross(x, y) / 0.048**2, -outwards, atol=1e-12)
    np.testing.assert_allclose(y[:4] / 0.048, np.tile([0, 0, -1], (4, 1)), atol=1e-12)


def test_a_turned_marker(tmp_path: Path) -> None:
    text = "target: bundle\ndictionary: 4X4_50\nmarkers:\n- {id: 2, side: 2cm, rotation_vector_deg: [0, 0, 90]}\n"
    target = bundle(tmp_path, text)
    # A quarter turn about z, x towards y: the top left corner goes to the top right.
    np.testing.assert_allclose(target.points[0], [0.01, -0.01, 0], atol=1e-12)
    same = bundle(tmp_path, text.replace("rotation_vector_deg: [0, 0, 90]", "quaternion_xyzw: [0, 0, 1, 1]"))
    np.testing.assert_allclose(same.points, target.points, atol=1e-12)


def test_a_bundle_s_file_needs_no_line_that_says_so(tmp_path: Path) -> None:
    said, unsaid = bundle(tmp_path, CUBE), bundle(tmp_path, CUBE.replace("target: bundle\n", ""))
    assert unsaid == said
    with pytest.raises(InputError, match="needs `dictionary: NAME`"):
        bundle(tmp_path, "cubes:\n- {side: 60mm, marker: 48mm, ids: [1]}\n")


def test_a_factor_is_part_of_the_spec(tmp_path: Path) -> None:
    cube = bundle(tmp_path, CUBE)
    np.testing.assert_allclose(cube.scaled(1.5).points, 1.5 * cube.points)
    assert parse_target(cube.scaled(1.5).spec) == cube.scaled(1.5)


def test_a_solid_has_no_sheet(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="one by one"):
        bundle(tmp_path, CUBE).artwork()


HEAD = "target: bundle\ndictionary: 4X4_50\nmarkers:\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("target: bundle\n", "dictionary"),
        ("target: bundle\ndictionary: 9X9\nmarkers: []\n", "unknown marker dictionary"),
        ("target: bundle\ndictionary: 4X4_50\n", "holds no markers"),
        (f"{HEAD}- {{id: 50, side: 2cm}}\n", "markers 0 to 49"),
        (f"{HEAD}- {{id: 1, side: 20}}\n", "has no unit"),
        (f"{HEAD}- {{id: 1, size: 20mm}}\n", "unknown key 'size'"),
        (f"{HEAD}- {{id: 1, side: 2cm}}\n- {{id: 1, side: 2cm}}\n", "twice"),
        (f"{HEAD}- {{id: 1, side: 2cm, position: [1mm, 2mm]}}\n", "three lengths"),
        (f"{HEAD}- {{id: 1, side: 2cm, quaternion_xyzw: [0, 0, 0, 0]}}\n", "norm 0"),
        (f"{HEAD}- {{id: 1, corners: [[0, 0, 0], [1cm, 0, 0], [1cm, 2cm, 0], [0, 2cm, 0]]}}\n", "no square"),
        (f"{HEAD}\t- id: 1\n", "tabs"),
        ("target: bundle\ndictionary: 4X4_50\ncubes:\n- {side: 1cm, marker: 2cm, ids: [1, 2, 3, 4, 5, 6]}\n", "larger"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        bundle(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b,c\n1,2,3\n", "columns a, b, c"),
        ("x,y,z\n1,2,3\n", "at least 4"),
        ("x,y,z\n1,2,3\n1,2,x\n", "point 2"),
        ("x,y,z\n1,2,3\n1,2,nan\n", "not finite"),
        ("id,x,y,z\n" + "1,0,0,0\n" * 4, "ids of their own"),
    ],
)
def test_a_bad_list_of_points(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        parse_target(f"points:{tmp_path / 'p.csv'}")


def test_yaml_as_people_write_it() -> None:
    text = """---
# a comment
name: "a: b"   # another
empty:
list:
- 1
- two
nested:
  - id: 3
    at: [1mm,
         -2.5mm]
  - {id: 4, at: [], flag: true}
"""
    assert parse_yaml(text) == {
        "name": "a: b",
        "empty": None,
        "list": [1, "two"],
        "nested": [{"id": 3, "at": ["1mm", "-2.5mm"]}, {"id": 4, "at": [], "flag": True}],
    }


def test_a_hash_inside_a_name_and_numbers_as_people_write_them() -> None:
    text = 'name: "board # 2"  # the spare\nturn: [1e-3, -2E+1, .5, 3, 1.5e2]\n'
    assert parse_yaml(text) == {"name": "board # 2", "turn": [1e-3, -20.0, 0.5, 3, 150.0]}
    assert parse_yaml("[010, 0x10, 12:30, 1_000, -.inf]") == [10, 16, "12:30", 1000, float("-inf")]
    assert parse_yaml(f"a: &a [1, 2]\nb: *a\nc: {'9' * 400}") == {"a": [1, 2], "b": [1, 2], "c": float("inf")}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}' if i else 'x'] * 9)}]\n" for i in range(7)),
            "line 6: it holds, or its aliases unfold to, more than 300000 values",
        ),
        ("&loop [*loop]", r"line 1: the alias \*loop stands within what it names"),
        ("a: *b", r"(?i)line 1: .*alias"),
        ("key: value\n" * 100_000, "1100000 characters; expected 1000000 at most"),
        ("a: 1\nb: 2\na: 3\n", "line 3: the key 'a' stands there twice"),
        ("[" * 100_000, "too deep"),
        ("id: 1\n  at: 2\n", "line 2: mapping values are not allowed"),
        ("id: !!python/object/apply:os.system [ls]\n", "line 1: could not determine a constructor"),
        ("on: 2020-13-45\n", "month must be"),
    ],
)
def test_a_text_that_unfolds_without_bound_or_is_no_yaml_is_refused(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_yaml(text)
