"""COLMAP's models: files that COLMAP wrote, the pixels it computes, both forms, every model, what cannot be."""

from __future__ import annotations

import base64
from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.errors import InputError
from calibrant.geometry import se3, so3

# Written by COLMAP 4.2 (pycolmap): a rig of two cameras, a moment.
TEXTS = {
    "cameras.txt": """# Camera list with one line of data per camera:
#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
# Number of cameras: 2
1 OPENCV 640 480 500 510 321 239 -0.10000000000000001 0.02 0.001 -0.002
2 SIMPLE_RADIAL_FISHEYE 320 240 200 160 120 0.050000000000000003
""",
    "images.txt": """# Image list with two lines of data per image:
1 0.82513699700703469 0.10314212462587934 -0.51571062312939664 0.20628424925175867 0.3 -0.2 1.5 1 left/0001.jpg
10.5 20.25 -1 10.5 20.25 -1
2 0.87249990245507392 0.12322090502160415 -0.43075797247895997 0.19495665653513589 0.39202396954496427 -0.19 """
    """1.4404990675233442 2 right/0001.jpg
21 20.25 -1
""",
    "rigs.txt": """# Rig calib list with one line of data per calib:
1 2 CAMERA 1 CAMERA 2 1 0.99500416527802582 0 0.099833416646828155 0 -0.20000000000000001 0.01 0.029999999999999999
""",
}
BINARIES = {
    "cameras.bin": "AgAAAAAAAAABAAAABAAAAIACAAAAAAAA4AEAAAAAAAAAAAAAAEB/QAAAAAAA4H9AAAAAAAAQdEAAAAAAAOBtQJqZmZmZmbm/"
    "exSuR+F6lD/8qfHSTWJQP/yp8dJNYmC/AgAAAAgAAABAAQAAAAAAAPAAAAAAAAAAAAAAAAAAaUAAAAAAAABkQAAAAAAAAF5A"
    "mpmZmZmZqT8=",
    "images.bin": "AgAAAAAAAAABAAAA96wbtIVn6j/3rBu0hWe6PxpMkZCzgOC/96wbtIVnyj8zMzMzMzPTP5qZmZmZmcm/AAAAAAAA+D8BAAAA"
    "bGVmdC8wMDAxLmpwZwACAAAAAAAAAAAAAAAAACVAAAAAAABANED//////////wAAAAAAACVAAAAAAABANED//////////wIA"
    "AADy2FnqhOvrP/xVQL1ni78/KnUS44mR279eW/r3VvTIP+9lHLTrFtk/UrgehetRyL9w5g7ASAz3PwIAAAByaWdodC8wMDAx"
    "LmpwZwABAAAAAAAAAAAAAAAAADVAAAAAAABANED//////////w==",
    "rigs.bin": "AQAAAAAAAAABAAAAAgAAAAAAAAABAAAAAAAAAAIAAAABwReo+RLX7z8AAAAAAAAAACzLi8uujrk/AAAAAAAAAACamZmZmZnJ"
    "v3sUrkfheoQ/uB6F61G4nj8=",
}
X_WORLD = np.array([0.1, 0.2, 1.0])
PIXELS = {
    "left/0001.jpg": (184.30619083949514, 144.23854830067538),
    "right/0001.jpg": (128.0331231332003, 85.69613814703268),
}
"""Where COLMAP projects that point, from the image's corner."""


def model(folder: Path, *, binary: bool = False) -> Path:
    folder.mkdir(parents=True)
    for name, text in TEXTS.items() if not binary else ():
        (folder / name).write_text(text)
    for name, text in BINARIES.items() if binary else ():
        (folder / name).write_bytes(base64.b64decode(text))
    return folder


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("within", ["", "sparse/0"])
def test_a_point_lands_where_colmap_puts_it(tmp_path: Path, binary: bool, within: str) -> None:
    model(tmp_path / "scene" / within, binary=binary)
    found = cb.convert(tmp_path / "scene", unit="m")
    assert {v.id for v in found.views} == set(PIXELS)
    for view in found.views:
        uv = found.cameras[str(view.camera)].project(se3.apply(view.T_camera_target, X_WORLD))
        np.testing.assert_allclose(uv + 0.5, PIXELS[view.id], atol=1e-9)


def test_a_rig_says_where_its_cameras_are(tmp_path: Path) -> None:
    found = cb.convert(model(tmp_path / "m"), unit="mm")
    first, second = found.views
    T = se3.inverse(found.transform("1", "2").matrix)
    np.testing.assert_allclose(T @ first.T_camera_target, second.T_camera_target, atol=1e-12)
    assert T[:3, 3] == pytest.approx([-2e-4, 1e-5, 3e-5], abs=1e-15)


@pytest.mark.parametrize("form", ["text", "binary"])
def test_what_was_read_is_written_again(tmp_path: Path, form: str) -> None:
    before = cb.convert(model(tmp_path / "m"))
    cb.convert(tmp_path / "m", tmp_path / "out", to="colmap", choose=[f"form={form}"])
    after = cb.convert(tmp_path / "out")
    for name, camera in before.cameras.items():
        assert after.cameras[name].parameters == pytest.approx(camera.parameters, abs=1e-12)
        assert after.cameras[name].image_size == camera.image_size
    for a, b in zip(before.views, after.views, strict=True):
        assert (a.id, a.camera) == (b.id, b.camera)
        np.testing.assert_allclose(a.T_camera_target, b.T_camera_target, atol=1e-12)


LENSES = {
    "SIMPLE_PINHOLE 640 480 500 320 240": ("pinhole", {"fx": 500, "fy": 500, "cx": 319.5}),
    "RADIAL 640 480 500 320 240 -.1 .02": ("brown", {"k1": -0.1, "k2": 0.02}),
    "FULL_OPENCV 640 480 500 510 320 240 .1 .2 .3 .4 .5 .6 .7 .8": ("rational", {"p2": 0.4, "k3": 0.5, "k6": 0.8}),
    "THIN_PRISM_FISHEYE 640 480 500 510 320 240 .1 .2 0 0 .3 .4 0 0": ("kannala_brandt", {"k3": 0.3, "k4": 0.4}),
    "SIMPLE_DIVISION 640 480 500 320 240 -.2": ("division", {"l1": -0.2}),
    "EUCM 640 480 500 510 320 240 .6 1.1": ("extended_unified", {"alpha": 0.6, "beta": 1.1}),
}


@pytest.mark.parametrize("line", LENSES)
def test_every_model_that_can_be_said(tmp_path: Path, line: str) -> None:
    (tmp_path / "cameras.txt").write_text(f"# a list\n7 {line}\n")
    camera = cb.convert(tmp_path / "cameras.txt").cameras["7"]
    name, terms = LENSES[line]
    assert camera.model.name == name
    assert {term: camera.parameters[term] for term in terms} == pytest.approx(terms)


NEAR = {
    "FOV 640 480 500 510 320 240 .9": (564.3963962031272, 90.42940552368614),
    "THIN_PRISM_FISHEYE 640 480 400 410 320 240 .1 .01 .001 -.002 .02 .003 .001 -.0005": (
        505.7975633048882,
        125.72307289347465,
    ),
}
"""Where COLMAP projects (0.5, -0.3, 1)."""


@pytest.mark.parametrize("line", NEAR)
def test_lenses_that_no_model_says_are_brought_near_on_request(tmp_path: Path, line: str) -> None:
    (tmp_path / "cameras.txt").write_text(f"1 {line}\n")
    found = cb.convert(tmp_path / "cameras.txt", answer=["approximate=yes"])
    np.testing.assert_allclose(found.camera.project([0.5, -0.3, 1.0]) + 0.5, NEAR[line], atol=0.5)
    assert any("px RMS" in n for n in found.notes)


WRONG = {
    "FOV 640 480 500 500 320 240 0.9": "FOV camera is a model .* px RMS",
    "FOV 640 480 500 500 320 240 -1": "omega",
    "EQUIRECTANGULAR 640 480 640 480": "EQUIRECTANGULAR camera is a model",
    "THIN_PRISM_FISHEYE 640 480 400 410 320 240 .1 .01 .001 0 .02 .003 0 0": "THIN_PRISM_FISHEYE camera .* px RMS",
    "OPENCV 640 480 500 500 320 240": "6 parameters|4 parameters",
    "PINHOLE 0 480 500 500 320 240": "image size",
    "PINHOLE 640 480 500 nan 320 240": "fy",
    "PINHOLE 640 480 500 500 9000 240": "principal point",
    "PINHOLE 640 480 500 500 1e400 240": "cx",
}


@pytest.mark.parametrize("line", WRONG)
def test_what_cannot_be_said_is_refused_by_name(tmp_path: Path, line: str) -> None:
    (tmp_path / "cameras.txt").write_text(f"1 {line}\n")
    with pytest.raises(InputError, match=WRONG[line]):
        cb.convert(tmp_path / "cameras.txt")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("0.82513699700703469", "0.9", "quaternion"),
        (" 1 left/", " 5 left/", "of camera 5"),
        ("1.5 1 left/0001.jpg", "1.5", "line 2"),
        ("right/0001.jpg", "left/0001.jpg", None),
        ("0.3 -0.2", "inf -0.2", "finite"),
    ],
)
def test_pictures_that_contradict(tmp_path: Path, old: str, new: str, words: str | None) -> None:
    folder = model(tmp_path / "m")
    (folder / "images.txt").write_text(TEXTS["images.txt"].replace(old, new))
    if words is None:  # two cameras may well call their pictures alike
        assert len(cb.convert(folder).views) == 2
        return
    with pytest.raises(InputError, match=words):
        cb.convert(folder)


@pytest.mark.parametrize("name", BINARIES)
def test_cut_binary_files_are_named(tmp_path: Path, name: str) -> None:
    folder = model(tmp_path / "m", binary=True)
    data = (folder / name).read_bytes()
    for length in (4, len(data) // 2, len(data) - 1):
        (folder / name).write_bytes(data[:length])
        with pytest.raises(InputError, match=name):
            cb.convert(folder)


def test_counts_that_promise_more(tmp_path: Path) -> None:
    folder = model(tmp_path / "m", binary=True)
    (folder / "images.bin").write_bytes(b"\xff" * 8 + bytes(100))
    with pytest.raises(InputError, match="too short"):
        cb.convert(folder)


def test_a_list_of_pictures_without_lines_of_points(tmp_path: Path) -> None:
    folder = model(tmp_path / "m")
    lines = [line for line in TEXTS["images.txt"].splitlines() if "jpg" in line]
    (folder / "images.txt").write_text("\n".join(lines))
    assert len(cb.convert(folder).views) == 2


def test_a_rig_of_ours_becomes_pictures_that_pycolmap_projects(tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    cb.convert(model(tmp_path / "m"), tmp_path / "out", to="colmap", choose=["form=binary"])
    found = pycolmap.Reconstruction(tmp_path / "out")
    for image in found.images.values():
        uv = found.cameras[image.camera_id].img_from_cam((image.cam_from_world() * X_WORLD)[None])[0]
        np.testing.assert_allclose(uv, PIXELS[image.name], atol=1e-6)


def test_the_camera_asked_for_comes_with_its_own_pictures(tmp_path: Path) -> None:
    found = cb.convert(model(tmp_path / "m"), camera="2")
    assert (list(found.cameras), [v.camera for v in found.views]) == (["2"], ["2"])


def test_a_blank_in_a_name(tmp_path: Path) -> None:
    folder = model(tmp_path / "m")
    (folder / "images.txt").write_text(TEXTS["images.txt"].replace("left/0001.jpg", "left 1.jpg"))
    found = cb.convert(folder, tmp_path / "out", to="colmap")
    assert found.views[0].id == "left 1.jpg"
    assert any("left_1.jpg" in n for n in found.notes)


def test_quaternions_are_colmaps(tmp_path: Path) -> None:
    found = cb.convert(model(tmp_path / "m"))
    q = [0.82513699700703469, 0.10314212462587934, -0.51571062312939664, 0.20628424925175867]
    np.testing.assert_allclose(found.views[0].T_camera_target[:3, :3], so3.from_quaternion_wxyz(q), atol=1e-12)
