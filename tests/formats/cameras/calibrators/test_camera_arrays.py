"""caliscope's and aniposelib's TOML: both ways of writing rotations, units, fisheyes, and back."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.formats.cameras.calibrators.rigs import assert_same, graph, rig, through

from calibrant.errors import InputError
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ReadOptions
from calibrant.formats.exchange.read import format_of, read_any
from calibrant.opencv import cv2

# As caliscope 0.11.8 writes it (CameraArray.to_toml), shortened to its digits.
CALISCOPE = """[cameras.0]
cam_id = 0
size = [1280, 720]
rotation_count = 0
error = 0.541
matrix = [[903.550124089999, 0.0, 618.3086297620227], [0.0, 907.8788668762852, 394.213230569746], [0.0, 0.0, 1.0]]
distortions = [-0.3320992998866297, 0.04641968621160267, -0.0042957715695196, 0.0041132401001997, 0.0665682301495769]
translation = [0.17125994082321383, -0.03234536459937444, 1.208386461814154]
rotation = [0.5, 1.2, -0.3]
exposure = -7
grid_count = 39
fisheye = false

[cameras.1]
cam_id = 1
size = [1280, 720]
matrix = [[400.0, 0.0, 630.0], [0.0, 401.0, 372.0], [0.0, 0.0, 1.0]]
distortions = [0.02, -0.004, 0.001, -0.0002]
translation = [0.0, 0.0, 0.0]
rotation = [0.0, 0.0, 0.0]
fisheye = true
"""
# Of aniposelib's tests/data/calib_motobs_7cam.toml.
ANIPOSE = """[cam_0]
name = "cam088"
size = [ 1440, 1080,]
matrix = [ [ 1850.506308260702, 0.0, 719.5,], [ 0.0, 1850.506308260702, 539.5,], [ 0.0, 0.0, 1.0,],]
distortions = [ -0.18925717533695158, 0.0, 0.0, 0.0, 0.0,]
rotation = [ -0.0016129363863306178, -0.002441180452093902, -0.007465964724818265,]
translation = [ 1.623648987402533, -0.601652230518438, 20.748877329963953,]

[cam_1]
name = "cam091"
size = [ 1440, 1080,]
matrix = [ [ 1807.290332446463, 0.0, 719.5,], [ 0.0, 1807.290332446463, 539.5,], [ 0.0, 0.0, 1.0,],]
distortions = [ -0.2128737763749453, 0.0, 0.0, 0.0, 0.0,]
rotation = [ -0.21614575169016556, -2.9760729913237074, 0.39535746473711036,]
translation = [ 116.06725432574943, 257.2440692072561, 1396.7286142164317,]

[metadata]
adjusted = false
error = 0.16285923171540084
"""


def put(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "camera_array.toml"
    file.write_text(text)
    return file


@pytest.mark.parametrize("fisheye", [False, True])
def test_a_point_of_the_world_lands_where_opencv_puts_it(tmp_path: Path, fisheye: bool) -> None:
    found = read_any(put(tmp_path, CALISCOPE))
    name = "cam_1" if fisheye else "cam_0"
    node = tomllib.loads(CALISCOPE)["cameras"][name[4:]]
    X = np.array([[[0.3, -0.1, 2.0]]])
    project = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    r, t, K, D = (np.array(node[k]) for k in ("rotation", "translation", "matrix", "distortions"))
    by_opencv = project(X, r, t, K, D)[0].ravel()
    T = graph(found).T(name, "world")
    np.testing.assert_allclose(found.cameras[name].project(T[:3, :3] @ X.ravel() + T[:3, 3]), by_opencv, atol=1e-9)


def test_matrices_of_older_files_are_the_same(tmp_path: Path) -> None:
    R = cv2.Rodrigues(np.array([0.5, 1.2, -0.3]))[0]
    old = CALISCOPE.replace("[0.5, 1.2, -0.3]", str(R.tolist())).replace("[cameras.", "[cam_")
    assert format_of(Document(put(tmp_path, old))).name == "caliscope"
    before = read_any(put(tmp_path, CALISCOPE))
    np.testing.assert_allclose(
        read_any(put(tmp_path, old)).transforms[0].matrix, before.transforms[0].matrix, atol=1e-12
    )


def test_aniposelib_is_asked_for_its_unit(tmp_path: Path) -> None:
    file = put(tmp_path, ANIPOSE)
    assert format_of(Document(file)).name == "aniposelib"
    with pytest.raises(InputError, match=r"camera_array\.toml: aniposelib's files do not say their unit.*--unit mm"):
        read_any(file)
    assert list(read_any(file, ReadOptions(places=False)).cameras) == ["cam088", "cam091"]
    found = read_any(file, ReadOptions(unit_m=1e-3))
    T = graph(found).T("cam091", "world")
    np.testing.assert_allclose(T[:3, 3], [0.11606725432574943, 0.2572440692072561, 1.3967286142164317], atol=1e-12)


@pytest.mark.parametrize("to", ["caliscope", "aniposelib"])
def test_there_and_back(tmp_path: Path, to: str) -> None:
    before = rig("pinhole", "brown", "kannala_brandt", imu=False)
    target = tmp_path / "array.toml"
    if to == "aniposelib":
        with pytest.raises(InputError, match="do not say their unit"):
            through(before, target, to)
        after = read_any(target, ReadOptions(unit_m=1.0))
        assert_same(after, before)
        return
    after = through(before, target, to)
    for name, camera in zip(("cam_0", "cam_1", "cam_2"), before.cameras.values()):
        np.testing.assert_allclose(after.cameras[name].values, camera.values, rtol=1e-14)
    np.testing.assert_allclose(graph(after).T("cam_0", "cam_2"), graph(before).T("cam0", "cam2"), atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[0.5, 1.2, -0.3]", "[0.5, 1.2]", "rotation of 2 and a translation of 3"),
        ("[0.5, 1.2, -0.3]", "[[1, 0, 0], [0, 1, 0], [0, 0, 2]]", "the rotation of cam_0 is none"),
        ("size = [1280, 720]\nrotation", "size = [1280]\nrotation", "a size of 1 numbers"),
        ("distortions = [0.02, -0.004, 0.001, -0.0002]", "distortions = [0.02, 0.1]", "2 distortion coefficients"),
        ("matrix = [[903.55", "matrix = [[nan, 903.55", "expected numbers"),
        ("907.8788668762852", "nan", "not finite"),
    ],
)
def test_bad_files_are_refused_by_name(tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(InputError, match=rf"camera_array\.toml: .*({words})"):
        read_any(put(tmp_path, CALISCOPE.replace(old, new)))


def test_real_files_of_both_ages_say_the_same(shared_data: Callable[[str], Path]) -> None:
    folder = shared_data("multicam_caliscope_charuco") / "post_optimization"
    new, old = read_any(folder / "camera_array.toml"), read_any(folder / "config.toml")
    assert list(new.cameras) == list(old.cameras) == ["cam_0", "cam_1", "cam_2", "cam_3"]
    for a, b in zip(new.transforms, old.transforms):
        np.testing.assert_allclose(a.matrix, b.matrix, atol=1e-12)
