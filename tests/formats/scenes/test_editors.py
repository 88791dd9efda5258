"""Blender, Unity and CoppeliaSim: points by their own published equations land on the pixels that calibrant has."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.data.results import as_transform
from calibrant.errors import InputError
from calibrant.formats.exchange.exchange_format import read_cameras
from calibrant.geometry import se3, so3

LENS = {"fx": 610.25, "fy": 605.5, "cx": 300.75, "cy": 260.0}
CENTRED = {"fx": 610.25, "fy": 610.25, "cx": 319.5, "cy": 239.5}
WIDE, HIGH = (640, 480), (480, 640)
T_WORLD_LEFT = se3.make(so3.exp([0.3, -0.4, 0.5]), [0.5, 0.1, 0.2])
T_WORLD_RIGHT = se3.make(so3.exp([2.1, 0.2, -0.3]), [-0.5, 0.3, 1.2])
# An F on a board: whoever mirrors it makes it unreadable.
F = np.array([[0, 0, 0], [0, 5, 0], [3, 5, 0], [0, 3, 0], [2, 3, 0]]) * 0.02


def rig(parameters: dict[str, float]) -> cb.CalibrationResult:
    camera = cb.Camera.create("pinhole", parameters, image_size=(640, 480))
    places = (as_transform("world", "left", T_WORLD_LEFT), as_transform("world", "right", T_WORLD_RIGHT))
    return read_cameras({"left": camera, "right": camera}, transforms=places)


def pixels(result: cb.CalibrationResult, name: str, X_world: np.ndarray) -> np.ndarray:
    return result.cameras[name].project(se3.apply(se3.inverse(result.transform("world", name).matrix), X_world))


def board_of(T_world_camera: np.ndarray) -> np.ndarray:
    """The F before a camera, in the world."""
    return se3.apply(T_world_camera @ se3.make(so3.exp([0.2, 0.3, -0.4]), [0.02, -0.03, 0.6]), F)


WORDS = {"unity": CENTRED | LENS, "blender": CENTRED | LENS, "coppelia": CENTRED}


@pytest.mark.parametrize("name", WORDS)
def test_there_and_back(tmp_path: Path, name: str) -> None:
    before = rig(WORDS[name])
    file = tmp_path / f"rig.{name}.json"
    cb.convert(before.write(tmp_path / "rig.json"), file)
    after = cb.convert(file)
    for camera, T in (("left", T_WORLD_LEFT), ("right", T_WORLD_RIGHT)):
        np.testing.assert_allclose(after.transform("world", camera).matrix, T, atol=1e-12)
        assert after.cameras[camera].parameters == pytest.approx(WORDS[name], rel=1e-12)
        assert after.cameras[camera].image_size == (640, 480)


def turned_by(x: float, y: float, z: float, w: float) -> np.ndarray:
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def unity_pixels(entry: dict, X_unity: np.ndarray) -> np.ndarray:
    """Unity's viewport from its left-handed world: right, up, ahead; (0, 0) is the lower left corner."""
    R = turned_by(*(entry["rotation"][k] for k in "xyzw"))
    right, up, ahead = ((X_unity - [entry["position"][k] for k in "xyz"]) @ R).T
    sensor, shift, lens = entry["sensorSize"], entry["lensShift"], entry["focalLength"]
    viewport_x = 0.5 - shift["x"] + right / ahead * lens / sensor["x"]
    viewport_y = 0.5 - shift["y"] + up / ahead * lens / sensor["y"]
    return np.stack([viewport_x * 640 - 0.5, (1 - viewport_y) * 480 - 0.5], axis=-1)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_the_text_of_a_board_is_not_mirrored_by_unity(tmp_path: Path, axis: str) -> None:
    before = rig(LENS)
    file = tmp_path / "rig.unity.json"
    cb.convert(before.write(tmp_path / "rig.json"), file, choose=[f"axis={axis}"])
    signs = np.where(np.array(list("xyz")) == axis, -1.0, 1.0)
    after = cb.convert(file, answer=[f"axis={axis}"])
    for entry in json.loads(file.read_text())["cameras"]:
        X = board_of(before.transform("world", entry["name"]).matrix)
        seen = pixels(before, entry["name"], X)
        np.testing.assert_allclose(unity_pixels(entry, X * signs), seen, atol=1e-9)
        np.testing.assert_allclose(pixels(after, entry["name"], X), seen, atol=1e-9)
        # The F's stem to its arm turns the same way in every picture: it reads as an F.
        ways = [
            np.linalg.det(np.stack([uv[1] - uv[0], uv[2] - uv[1]])) for uv in (seen, unity_pixels(entry, X * signs))
        ]
        assert np.sign(ways[0]) == np.sign(ways[1])


def unity(tmp_path: Path, **said: object) -> Path:
    file = tmp_path / "unity.json"
    values = {"position": {"x": 1, "y": 2, "z": 3}, "eulerAngles": [20, 30, 40], "fieldOfView": 60.0, **said}
    file.write_text(json.dumps({"width": 640, "height": 480, "Main Camera": values}))
    return file


def test_unity_turns_by_z_then_x_then_y(tmp_path: Path) -> None:
    found = cb.convert(unity(tmp_path), answer=["axis=y"])
    (cx, sx), (cy, sy), (cz, sz) = ((math.cos(math.radians(a)), math.sin(math.radians(a))) for a in (20, 30, 40))
    Rx = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    Ry = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    Rz = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    ahead_in_unity = Ry @ Rx @ Rz @ [0, 0, 1]
    T = found.transform("world", "Main Camera").matrix
    np.testing.assert_allclose(T[:3, 2], ahead_in_unity * [1, -1, 1], atol=1e-12)
    np.testing.assert_allclose(T[:3, 1], -(Ry @ Rx @ Rz @ [0, 1, 0]) * [1, -1, 1], atol=1e-12)
    np.testing.assert_allclose(T[:3, 3], [1, -2, 3], atol=1e-15)
    assert found.camera.parameters["fy"] == pytest.approx(240 / math.tan(math.radians(30)))
    assert found.camera.parameters["cx"] == 319.5


def blender_pixels(entry: dict, X: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Blender's picture: view to the camera's -z, lens over sensor of the fitted side, shift in shares of it."""
    M = np.array(entry["matrix_world"])
    right, up, back = ((X - M[:3, 3]) @ M[:3, :3]).T
    aspect = entry.get("pixel_aspect_y", 1) / entry.get("pixel_aspect_x", 1)
    fit = entry.get("sensor_fit", "AUTO")
    across = fit == "HORIZONTAL" or (fit == "AUTO" and size[0] >= aspect * size[1])
    side = size[0] if across else size[1] * aspect
    sensor = entry["sensor_height"] if fit == "VERTICAL" else entry["sensor_width"]
    x = (right / -back * entry["lens"] / sensor - entry.get("shift_x", 0)) * side
    y = (up / -back * entry["lens"] / sensor - entry.get("shift_y", 0)) * side / aspect
    return np.stack([size[0] / 2 + x - 0.5, size[1] / 2 - y - 0.5], axis=-1)


@pytest.mark.parametrize(
    ("fit", "size"),
    [
        ("AUTO", (640, 480)),
        ("AUTO", (480, 640)),
        ("HORIZONTAL", (480, 640)),
        ("VERTICAL", (640, 480)),
        (None, (640, 480)),
    ],
)
def test_blender_fits_its_sensor_by_the_side_that_it_says(
    tmp_path: Path, fit: str | None, size: tuple[int, int]
) -> None:
    gl = T_WORLD_LEFT @ np.diag([1.0, -1, -1, 1])
    entry = {"matrix_world": gl.tolist(), "lens": 35, "sensor_width": 36, "sensor_height": 24, "shift_x": 0.1}
    entry |= {"shift_y": -0.05, "pixel_aspect_x": 1, "pixel_aspect_y": 1.2} | ({"sensor_fit": fit} if fit else {})
    file = tmp_path / "b.json"
    resolution = {"resolution_x": 2 * size[0], "resolution_y": 2 * size[1], "resolution_percentage": 50}
    file.write_text(json.dumps({"left": entry | resolution}))
    found = cb.convert(file)
    assert found.camera.image_size == size
    X = board_of(T_WORLD_LEFT)
    np.testing.assert_allclose(pixels(found, "left", X), blender_pixels(entry, X, size), atol=1e-9)


PRINTED = """>>> bpy.context.scene.camera.matrix_world
Matrix(((0.6859206557273865, -0.32401347160339355, 0.6515582203865051, 7.358891487121582),
        (0.7276763319969177, 0.305420845746994, -0.6141703724861145, -6.925790786743164),
        (0.0, 0.8953956365585327, 0.44527140259742737, 4.958309173583984),
        (0.0, 0.0, 0.0, 1.0)))
lens = 50.0
sensor_width: 36.0
"""
ROUNDED = """<Matrix 4x4 (0.6859, -0.3240,  0.6516,  7.3589)
            (0.7277,  0.3054, -0.6142, -6.9258)
            (0.0000,  0.8954,  0.4453,  4.9583)
            (0.0000,  0.0000,  0.0000,  1.0000)>"""


@pytest.mark.parametrize("text", [PRINTED, ROUNDED])
def test_prints_of_blender(tmp_path: Path, text: str) -> None:
    file = tmp_path / "print.txt"
    file.write_text(text)
    said = [] if "lens" in text else ["lens=50", "sensor_width=36"]
    found = cb.convert(file, image_size="1920x1080", answer=said)
    assert found.camera.parameters["fx"] == pytest.approx(50 / 36 * 1920)
    # Blender's startup scene: the camera looks at the cube at the origin, near the middle of the picture.
    u, v = pixels(found, "camera", np.zeros(3))
    assert (abs(u - 959.5) < 30, abs(v - 539.5) < 30) == (True, True)


def test_what_blender_left_out_is_asked(tmp_path: Path) -> None:
    file = tmp_path / "print.txt"
    file.write_text(ROUNDED)
    with pytest.raises(InputError, match=r"lens and sensor_width \(mm\) is not in the file; say it: answer lens=50"):
        cb.convert(file, image_size="1920x1080")


def test_blender_and_its_rotation_by_angles(tmp_path: Path) -> None:
    file = tmp_path / "b.json"
    # The startup camera again: 63.559, 0, 46.692 degrees.
    euler = [math.radians(a) for a in (63.5593, 0.0, 46.6919)]
    place = {"location": [7.358891, -6.925791, 4.958309], "rotation_euler": euler}
    file.write_text(json.dumps({**place, "lens": 50, "sensor_width": 36, "resolution_x": 1920, "resolution_y": 1080}))
    (tmp_path / "p.txt").write_text(PRINTED)
    expected = cb.convert(tmp_path / "p.txt", image_size="1920x1080").transform("world", "camera").matrix
    np.testing.assert_allclose(cb.convert(file).transform("world", "camera").matrix, expected, atol=1e-5)


def coppelia_pixels(pose: list[float], angle_deg: float, X: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """PyRep's intrinsics: negative focal lengths, since the sensor's x is left and its y up."""
    x, y, z = ((X - pose[:3]) @ turned_by(*pose[3:])).T
    half = math.tan(math.radians(angle_deg) / 2)
    across, high = (half, half / (size[0] / size[1])) if size[0] > size[1] else (half * size[0] / size[1], half)
    fx, fy = -size[0] / (2 * across), -size[1] / (2 * high)
    return np.stack([fx * x / z + size[0] / 2 - 0.5, fy * y / z + size[1] / 2 - 0.5], axis=-1)


@pytest.mark.parametrize("size", [(640, 480), (480, 640), (128, 128)])
def test_sensors_of_coppelia_by_pyreps_equations(tmp_path: Path, size: tuple[int, int]) -> None:
    q = np.array([0.1, -0.7, 0.3, 0.5])
    pose = [0.3, -0.2, 1.1, *(q / np.linalg.norm(q)).tolist()]
    file = tmp_path / "c.json"
    file.write_text(json.dumps({"front": {"pose": pose, "perspective_angle": 60.0, "resolution": list(size)}}))
    found = cb.convert(file)
    X = board_of(found.transform("world", "front").matrix)
    np.testing.assert_allclose(pixels(found, "front", X), coppelia_pixels(pose, 60.0, X, size), atol=1e-9)


def test_a_pose_alone_is_read_where_it_is_said_what_it_is(tmp_path: Path) -> None:
    file = tmp_path / "pose.txt"
    file.write_text("0.3 -0.2 1.1 0.0 0.6 0.0 0.8\n")
    with pytest.raises(InputError, match="say it: answer perspective_angle=60"):
        cb.convert(file, read_as="coppelia", image_size="64x48")
    found = cb.convert(file, read_as="coppelia", image_size="64x48", answer=["perspective_angle=60"])
    # Half a turn about z away from the sensor's own axes: x left and y up.
    expected = se3.make(turned_by(0, 0.6, 0, 0.8) @ np.diag([-1.0, -1, 1]), [0.3, -0.2, 1.1])
    np.testing.assert_allclose(found.transform("world", "camera").matrix, expected, atol=1e-12)


def test_observations_of_rlbench(tmp_path: Path) -> None:
    pose = [0.3, -0.2, 1.1, 0.0, 0.6, 0.0, 0.8]
    f = -64 / math.tan(math.radians(30))
    T = se3.make(turned_by(*pose[3:]), pose[:3])
    K = [[f, 0, 64], [0, f, 64], [0, 0, 1]]
    file = tmp_path / "misc.json"
    file.write_text(json.dumps({"front_camera_extrinsics": T.tolist(), "front_camera_intrinsics": K, "near": 0.1}))
    found = cb.convert(file)
    assert found.cameras["front"].image_size == (128, 128)
    X = board_of(found.transform("world", "front").matrix)
    np.testing.assert_allclose(pixels(found, "front", X), coppelia_pixels(pose, 60.0, X, (128, 128)), atol=1e-9)


def test_what_coppelia_cannot_say_is_refused_or_said(tmp_path: Path) -> None:
    source = rig(LENS).write(tmp_path / "rig.json")
    with pytest.raises(InputError, match=r"off by up to 2\d\.\d px\. Take that with choose nearest=yes"):
        cb.convert(source, tmp_path / "r.coppelia.json")
    made = cb.convert(source, tmp_path / "r.coppelia.json", choose=["nearest=yes"])
    assert any("off by up to" in note for note in made.notes)


POSE = {"pose": [0, 0, 0, 0, 0, 0, 1], "perspective_angle": 60, "resolution": [64, 48]}
MATRIX = {"matrix_world": np.eye(4).tolist(), "lens": 50, "sensor_width": 36, "resolution": [64, 48]}
BAD = {
    "angle": (POSE | {"perspective_angle": 1.0}, "may be degrees or radians"),
    "norm": (POSE | {"pose": [0, 0, 0, 0, 0, 0, 2]}, "has a norm of 2"),
    "six": (POSE | {"pose": [0, 0, 0, 0, 0, 1]}, "expected 7 finite numbers"),
    "size": ({"pose": POSE["pose"], "perspective_angle": 60}, "image size"),
    "wide": (POSE | {"perspective_angle": 180}, "between 0 and 180"),
    "bent": (POSE | {"k1": 0.3}, "bends"),
    "mirror": (MATRIX | {"matrix_world": np.diag([-1.0, 1, 1, 1]).tolist()}, "is a mirror"),
    "sheared": (MATRIX | {"matrix_world": [[1, 1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}, "no pose"),
    "flat": (MATRIX | {"matrix_world": np.zeros((4, 4)).tolist()}, "axis of length 0"),
    "ortho": (MATRIX | {"type": "ORTHO"}, "expected PERSP"),
    "lens": (MATRIX | {"lens": -1}, "above 0"),
    "fit": (MATRIX | {"sensor_fit": "WIDE"}, "expected AUTO, HORIZONTAL, VERTICAL"),
    "nan": (MATRIX | {"lens": "x"}, "expected 1 finite numbers"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_wrong_is_said_with_the_file(tmp_path: Path, name: str) -> None:
    values, words = BAD[name]
    file = tmp_path / f"{name}.json"
    file.write_text(json.dumps(values))
    with pytest.raises(InputError) as caught:
        cb.convert(file)
    assert words in str(caught.value)
    assert str(caught.value).startswith(str(file))
