"""Own points: read as 3D-EasyCalib and cv2.FileStorage write them; what is wrong is said with what was expected."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant.errors import InputError
from calibrant.formats.points_yaml import own_observations, read_own_points
from calibrant.targets.point_folder import PointFolder
from calibrant.targets.registry import parse_target

SIZE = (640, 480)
OBJ = np.array([[0, 0, 0], [30, 0, 0], [0, 30, 0], [30, 30, 5.5], [60, 15, -2]], dtype=np.float32)
CORNERS = np.array([[100.25, 80], [300, 85], [110, 260], [310, 270], [420.5, 170]], dtype=np.float32)


def text(corners: str = "", obj: str = "", extra: str = "", rows: int = 5) -> str:
    corners = corners or ", ".join(f"{v:g}" for v in CORNERS.ravel())
    obj = obj or ", ".join(f"{v:g}" for v in OBJ.ravel())
    return (
        f'%YAML:1.0\n---\ncorners: !!opencv-matrix\n   rows: {rows}\n   cols: 1\n   dt: "2f"\n   data: [ {corners} ]\n'
        f'obj: !!opencv-matrix\n   rows: {rows}\n   cols: 1\n   dt: "3f"\n   data: [ {obj} ]\n{extra}'
    )


def write(path: Path, content: str) -> Path:
    path.write_text(content)
    return path


def test_the_manuals_form(tmp_path: Path) -> None:
    own = read_own_points(write(tmp_path / "a.yml", text()))
    np.testing.assert_array_equal(own.uv, CORNERS)
    np.testing.assert_allclose(own.points, 1e-3 * OBJ.astype(float), rtol=1e-15)
    metres = read_own_points(tmp_path / "a.yml", metres=1.0)
    np.testing.assert_array_equal(metres.points, OBJ)


@pytest.mark.parametrize("shape", [(-1, 1, 0), (1, -1, 0), (-1, 0)])
def test_what_opencv_writes(tmp_path: Path, shape: tuple[int, ...]) -> None:
    """n rows of 2f, n columns of 2f, and n rows of 2 columns; a flat target in two coordinates."""

    def shaped(a: NDArray[np.float32]) -> NDArray[np.float32]:
        return a.reshape([a.shape[1] if n == 0 else n for n in shape])

    storage = cv2.FileStorage(str(tmp_path / "b.yml"), cv2.FILE_STORAGE_WRITE)
    storage.write("corners", shaped(CORNERS))
    storage.write("obj", shaped(np.ascontiguousarray(OBJ[:, :2])))
    storage.release()
    own = read_own_points(tmp_path / "b.yml")
    np.testing.assert_array_equal(own.uv, CORNERS)
    np.testing.assert_allclose(own.points, 1e-3 * np.column_stack([OBJ[:, :2], np.zeros(5)]), rtol=1e-15)


LINE = ", ".join(f"{10 * i} {20 * i} 0".replace(" ", ", ") for i in range(5))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (text(extra="focal: 3\n"), "unknown key 'focal'; expected two matrices"),
        (text().replace("obj:", "object:"), "unknown key 'object'"),
        (text().partition("obj:")[0], "there is no obj"),
        ("%YAML:1.0\n---\n", "no keys and values"),
        ("corners: [1, 2]\nobj: [1, 2]\n", "corners is no matrix of OpenCV"),
        (text(corners="1, 2, 3, 4"), "do not fit rows x cols"),
        (text().replace('dt: "2f"', 'dt: "5f"', 1).replace("rows: 5", "rows: 2", 1), "expected n rows of 2f"),
        (text(corners=", ".join("1 2".replace(" ", ", ") for _ in range(5))), "5 times"),
        (text(obj=LINE), "all 5 points of obj lie on a line on the target"),
        (text(corners="1, 1, 2, 2, 3, 3, 4, 4, 5, 5"), "of corners lie on a line in the image"),
        (text(corners="1, 2, .nan, 4, 5, 6, 7, 8, 9, 1"), "corners: point 2 is [nan, 4.0]; expected finite"),
        (text(obj=", ".join(["0", "0", ".inf"] * 5)), "obj: point 1 is [0.0, 0.0, inf]"),
        (text("1, 2, 3, 4, 5, 7", "1, 2, 3, 4, 5, 6, 7, 8, 0", rows=3), "3 points; expected at least 4"),
        (text().replace("rows: 5", "rows: 4", 1).replace(", 420.5, 170 ]", " ]"), "corners has 4 points and obj has 5"),
        ("corners: [", "not YAML"),
    ],
)
def test_what_cannot_be_used_is_named(tmp_path: Path, content: str, said: str) -> None:
    with pytest.raises(InputError) as error:
        read_own_points(write(tmp_path / "bad.yml", content))
    assert said in str(error.value)
    assert "bad.yml" in str(error.value)


def test_observations_take_the_file_beside_each_image(tmp_path: Path) -> None:
    write(tmp_path / "a.yml", text())
    turned = text(", ".join(f"{v:g}" for v in CORNERS[::-1].ravel()), ", ".join(f"{v:g}" for v in OBJ[::-1].ravel()))
    write(tmp_path / "b.yaml", turned)
    target = parse_target(f"points:{tmp_path}")
    assert isinstance(target, PointFolder)
    found = own_observations(["x/a.png", "x/b.png", "x/c.png"], target, image_size=SIZE)
    assert [v.id for v in found.views] == ["a.png", "b.png"]
    assert found.views[1].point_ids.tolist() == [4, 3, 2, 1, 0]
    assert found.missed[0].id == "c.png"
    assert "there is no c.yml" in found.missed[0].reason
    assert "as mm" in found.notes[0]


def test_points_outside_the_image_and_images_without_files(tmp_path: Path) -> None:
    write(tmp_path / "a.yml", text())
    target = PointFolder(str(tmp_path))
    with pytest.raises(InputError, match=r"corner 5 is at \(420.5, 170\), outside its image of 400x300 px"):
        own_observations(["a.png"], target, image_size=(400, 300))
    with pytest.raises(InputError, match="no image has its points beside it"):
        own_observations(["q.png"], target, image_size=SIZE)
    with pytest.raises(InputError, match="two images would take their points"):
        own_observations(["one/a.png", "two/a.png"], target, image_size=SIZE)
