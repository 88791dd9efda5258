"""Shapes: symmetries of boxes and meshes, files of meshes, and what a camera sees of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.perceive.boxes_on_a_table import camera_at

from calibrant.errors import InputError
from calibrant.formats.meshes.read import read_mesh
from calibrant.geometry import se3, so3
from calibrant.perceive.object_pose.poses import ObjectPose
from calibrant.perceive.object_pose.rendered import outline, visible_triangles
from calibrant.perceive.object_pose.shapes import Shape, box, mesh, parse_shape


def bracket() -> Shape:
    """An L of three different lengths: no symmetry but its mirror image, which is no motion."""
    a, b = box([0.06, 0.02, 0.01]), box([0.01, 0.02, 0.04])
    moved = b.vertices + np.array([0.025, 0.0, 0.025])
    return mesh(np.concatenate([a.vertices, moved]), np.concatenate([a.triangles, b.triangles + 8]), name="bracket")


def cylinder(n: int = 48) -> Shape:
    angle = 2 * np.pi * np.arange(n) / n
    ring = 0.02 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    v = np.concatenate([np.column_stack([ring, np.full(n, z)]) for z in (0.0, 0.05)] + [[[0, 0, 0], [0, 0, 0.05]]])
    t = []
    for i in range(n):
        j = (i + 1) % n
        t += [(i, j, n + j), (i, n + j, n + i), (2 * n, j, i), (2 * n + 1, n + i, n + j)]
    return mesh(v, np.array(t), name="cylinder")


@pytest.mark.parametrize(("sides", "count"), [((54, 37, 5), 4), ((40, 40, 5), 8), ((40, 40, 40), 24), ((5, 40, 40), 8)])
def test_boxes_have_the_turns_of_their_sides(sides: tuple[float, ...], count: int) -> None:
    shape = box(1e-3 * np.array(sides))
    assert len(shape.symmetries) == count
    assert shape.symmetries[0] == pytest.approx(np.eye(4))
    for S in shape.symmetries:
        moved = se3.apply(S, shape.vertices)
        nearest = np.linalg.norm(moved[:, None] - shape.vertices, axis=2).min(axis=1)
        assert nearest.max() < 1e-12
        assert np.linalg.det(S[:3, :3]) == pytest.approx(1)


def test_a_mesh_of_a_box_has_the_boxs_symmetries() -> None:
    own = box([0.05, 0.03, 0.02])
    turned = so3.exp([0.3, -0.2, 0.5])
    found = mesh(own.vertices @ turned.T + np.array([0.1, 0.0, 0.2]), own.triangles)
    assert len(found.symmetries) == 4
    assert found.axis is None


def test_an_asymmetric_mesh_has_none_and_a_cylinder_an_axis() -> None:
    assert len(bracket().symmetries) == 1
    round_one = cylinder()
    assert round_one.axis is not None
    assert abs(round_one.axis[2]) == pytest.approx(1.0, abs=1e-3)
    assert len(round_one.symmetries) == 2  # and upside down


def test_normals_point_outwards_whichever_way_triangles_run() -> None:
    own = box([0.05, 0.03, 0.02])
    for triangles in (own.triangles, own.triangles[:, ::-1]):
        assert np.all(mesh(own.vertices, triangles).offsets > 0)


def _text_stl(shape: Shape) -> str:
    facets = []
    for t in shape.triangles:
        corners = "".join(f"vertex {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in 1e3 * shape.vertices[t])
        facets.append(f"facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n")
    return "solid part\n" + "".join(facets) + "endsolid\n"


def _binary_stl(shape: Shape) -> bytes:
    kind = np.dtype([("numbers", "<f4", (4, 3)), ("more", "<u2")])
    rows = np.zeros(len(shape.triangles), kind)
    rows["numbers"][:, 1:] = 1e3 * shape.vertices[shape.triangles]
    return b"solid by a program that lies".ljust(80) + np.uint32(len(rows)).tobytes() + rows.tobytes()


def _obj(shape: Shape) -> str:
    v = "".join(f"v {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in 1e3 * shape.vertices)
    return (
        "# a part\n"
        + v
        + "f -8/1/1 -7//2 -5 -6\n"
        + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in shape.triangles)
    )


@pytest.mark.parametrize("kind", ["text", "binary", "obj"])
def test_files_give_the_same_shape(kind: str, tmp_path: Path) -> None:
    own = box([0.054, 0.037, 0.005])
    file = tmp_path / ("part.obj" if kind == "obj" else "part.stl")
    data = {"text": _text_stl(own).encode(), "binary": _binary_stl(own), "obj": _obj(own).encode()}[kind]
    file.write_bytes(data)
    found = read_mesh(file)
    assert len(found.vertices) == 8
    assert np.ptp(found.vertices, axis=0) == pytest.approx([54, 37, 5], rel=1e-6)
    shape, words = parse_shape(f"mesh:{file}")
    assert "taken as mm" in words
    assert np.ptp(shape.vertices, axis=0) == pytest.approx([0.054, 0.037, 0.005], rel=1e-6)
    assert len(shape.symmetries) == 4
    assert parse_shape(f"mesh:{file}:m")[0].size == pytest.approx(1000 * shape.size)


@pytest.mark.parametrize(
    ("name", "data", "says"),
    [
        ("a.stl", b"nothing of the kind", "no STL"),
        ("a.stl", b"\0" * 80 + (12).to_bytes(4, "little") + b"\0" * 100, "cut off"),
        ("a.stl", b"solid x\nfacet normal 0 0 1\nouter loop\nvertex 1 2\nendloop", "three numbers"),
        ("a.obj", b"v 1 2 3\nf 1 2 3\n", "line 2"),
        ("a.obj", b"v 1 2 3\n", "no triangles"),
        ("a.ply", b"ply", ".stl or .obj"),
    ],
)
def test_damaged_files_are_named(name: str, data: bytes, says: str, tmp_path: Path) -> None:
    file = tmp_path / name
    file.write_bytes(data)
    with pytest.raises(InputError, match=says):
        read_mesh(file)


@pytest.mark.parametrize("spec", ["box:54x37mm", "box:54x37x5", "cube:40", "ball:3mm", "box:0x1x1mm", "cube"])
def test_specs_that_say_no_object_are_refused(spec: str) -> None:
    with pytest.raises(InputError):
        parse_shape(spec)


def test_specs_say_their_sides() -> None:
    assert parse_shape("box:54x37x5mm")[0].sides == pytest.approx([0.054, 0.037, 0.005])
    assert parse_shape("cube:1.5in")[0].sides == pytest.approx([0.0381] * 3)


def test_a_camera_sees_the_front_and_its_outline_runs_around_it() -> None:
    camera, shape = camera_at(308.0, (320, 240)), box([0.04, 0.04, 0.04])
    T = se3.make(np.eye(3), [0.0, 0.0, 0.3])
    index = visible_triangles(shape, camera, T)
    assert set(np.unique(index[index >= 0])) == set(np.flatnonzero(shape.normals[:, 2] < -0.5))
    side = 0.04 * 308 / 0.28
    assert np.sum(index >= 0) == pytest.approx(side**2, rel=0.05)
    found = outline(shape, camera, T, index)
    assert len(np.unique(found.side)) == 4
    middle = camera.project([0.0, 0.0, 0.28])
    across = np.sum(found.outward * (found.uv - middle), axis=1)
    assert across == pytest.approx(np.full(len(across), side / 2), rel=1e-6)


def test_errors_are_taken_modulo_symmetries_and_poses_carried_to_other_frames() -> None:
    shape = box([0.054, 0.037, 0.005])
    truth = se3.make(so3.exp([0.1, 0.2, 0.3]), [0.01, 0.02, 0.3])
    spread = np.diag([1e-3, 2e-3, 3e-3, 1e-4, 2e-4, 3e-4]) ** 2
    turned = ObjectPose("box", truth @ se3.make(so3.exp([0, 0, np.pi]), np.zeros(3)), spread, shape.symmetries)
    assert turned.error(truth) == pytest.approx(np.zeros(6), abs=1e-12)
    assert turned.nearest_to(truth).matrix == pytest.approx(truth, abs=1e-12)
    T = se3.make(so3.exp([0.4, -0.2, 0.9]), [0.5, 0.1, 0.2])
    moved = turned.moved(T, "base")
    assert moved.frame == "base"
    assert np.linalg.eigvalsh(moved.covariance) == pytest.approx(np.linalg.eigvalsh(spread), rel=1e-9)
    hand = np.diag([1e-3] * 3 + [0.0] * 3) ** 2
    lever = np.linalg.norm(truth[:3, 3])
    more = moved.moved(np.eye(4), "base", hand).covariance - moved.covariance
    assert np.trace(turned.moved(np.eye(4), "b", hand).covariance[3:, 3:] - spread[3:, 3:]) == pytest.approx(
        2 * 1e-6 * lever**2
    )
    assert np.linalg.eigvalsh(more).min() > -1e-15
