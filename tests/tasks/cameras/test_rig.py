"""`calibrant rig`: images of many cameras matched and searched, several boards, videos, what does not hang together."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calibrant as cb
from calibrant.calibrate.cell import rig
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.data.details import SharedMoments
from calibrant.errors import DetectionError, InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.opencv import cv2
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import look_at_board
from calibrant.targets.registry import parse_target

BOARD = "chessboard:7x6:30mm"
FRAMES = 10
LENS = {"fx": 330.0, "fy": 328.0, "cx": 161.0, "cy": 118.0, "k1": -0.1}
WIDE = {"fx": 210.0, "fy": 210.0, "cx": 138.0, "cy": 92.0, "k1": 0.02}
CAMERAS: Mapping[str, Camera] = {
    "left": Camera.create("brown", LENS, image_size=(320, 240)),
    "top": Camera.create("kannala_brandt", WIDE, image_size=(270, 180)),
    "right": Camera.create("brown", LENS, image_size=(320, 240)),
}
PLACES = {
    "left": np.eye(4),
    "top": se3.make(so3.exp([0.12, 0.0, 0.05]), [0.02, -0.08, 0.0]),
    "right": se3.make(so3.exp([0.0, -0.15, 0.0]), [0.12, 0.0, 0.01]),
}
"""T_left_camera."""


def photos(folder: Path, *, without: Mapping[str, tuple[int, ...]] | None = None, inverted: str = "") -> dict[str, str]:
    """Pictures NN.png of every camera in a folder of its own; without: frames that a camera has none of."""
    rng = np.random.default_rng(3)
    art = parse_target(BOARD).artwork()
    T = look_at_board(CAMERAS["left"], parse_target(BOARD).points, FRAMES, rng=rng, distance=(0.45, 0.6), tilt_deg=40)
    for name, camera in CAMERAS.items():
        (folder / name).mkdir()
        for k, pose in enumerate(T):
            if k in (without or {}).get(name, ()):
                continue
            M = se3.inverse(PLACES[name]) @ pose
            image = render(art, camera, M, rng=rng, look=Look(clutter=0, noise_grey=1.5))
            cv2.imwrite(str(folder / name / f"{k:02d}.png"), 255 - image if name == inverted else image)
    return {name: str(folder / name) for name in CAMERAS}


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return photos(tmp_path_factory.mktemp("rig"))


def off_mm(result: CalibrationResult, name: str) -> float:
    return float(1e3 * np.linalg.norm(result.transform("left", name).matrix[:3, 3] - PLACES[name][:3, 3]))


def test_three_cameras_of_two_models_and_sizes(images: dict[str, str]) -> None:
    result = cb.rig(images=images, target=BOARD, model=["top:kannala_brandt"], fix=["left:k3", "right:k3"])
    assert result.kind == "rig"
    assert {n: c.model.name for n, c in result.cameras.items()} == {
        "left": "brown", "top": "kannala_brandt", "right": "brown",
    }  # fmt: skip
    for name in ("top", "right"):
        sigma = result.transform("left", name).sigma_translation_mm
        assert sigma is not None
        assert off_mm(result, name) < 5 * float(np.linalg.norm(sigma))
    shared = result.detail(SharedMoments)
    assert shared is not None
    assert shared.counts[0][2] >= 8
    assert result.check("matching").message.startswith(f"{FRAMES} moments of 3 cameras by name")
    assert "Moments seen together" in result.summary()


def test_a_camera_with_one_picture_and_a_known_lens(images: dict[str, str], tmp_path: Path) -> None:
    options = {"target": BOARD, "model": ["top:kannala_brandt"], "fix": ["left:k3"]}
    CalibrationResult("intrinsics", "ok", cameras={"camera": CAMERAS["right"]}).write(tmp_path / "right.json")
    one = {**images, "right": f"{images['right']}/04.png"}
    result = cb.rig(images=one, camera=[f"right={tmp_path / 'right.json'}"], **options)  # type: ignore[arg-type]
    assert off_mm(result, "right") < 5
    assert result.check("shared-moments").status == "warn"


def test_cameras_that_nothing_ties_are_named_with_the_pair_to_take(tmp_path: Path) -> None:
    late = photos(tmp_path, without={"left": (5, 6, 7, 8, 9), "top": (5, 6, 7, 8, 9), "right": (0, 1, 2, 3, 4)})
    with pytest.raises(RefusedError, match=r"right saw .* take pictures in which (left|top) and right both see"):
        cb.rig(images=late, target=BOARD, fix=["k3", "k2", "tangential"])


def test_the_times_of_pictures_come_from_a_table(
    images: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    late = {"right": 0.02, "top": -0.01, "left": 0.0}
    rows = [f"{name},{k:02d}.png,{0.5 * k + s:.3f}" for k in range(FRAMES) for name, s in late.items()]
    (tmp_path / "times.csv").write_text("\n".join(("Camera,Image,Time", *rows)))
    given: list[Mapping[str, Mapping[str, float]]] = []

    def without_times(
        *seen: object, times: Mapping[str, Mapping[str, float]], calibrate: Any = rig.calibrate_rig, **options: object
    ) -> CalibrationResult:
        given.append(times)
        found: CalibrationResult = calibrate(*seen, **options)  # the boards of these pictures jump
        return found

    monkeypatch.setattr(rig, "calibrate_rig", without_times)
    options = {"target": BOARD, "model": ["top:kannala_brandt"], "fix": ["k3"], "times": tmp_path / "times.csv"}
    result = cb.rig(images=images, exclude=["07.png"], **options)  # type: ignore[arg-type]
    assert list(given[0]) == list(images)
    for name, s in late.items():
        mine = {f"{k:02d}": 0.01 + 0.5 * k + s for k in range(FRAMES) if k != 7}
        assert given[0][name] == pytest.approx(mine)
    assert result.check("times").message == "times of times.csv: cameras by name, pictures by name"
    assert result.inputs[-1]["file"] == str(tmp_path / "times.csv")
    (tmp_path / "times.csv").write_text("\n".join(("camera,image,time", *rows[:-1])))
    with pytest.raises(InputError, match=r"no time of 09[.]png of camera left \("):
        cb.rig(images=images, **options)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="leave out fps"):
        cb.rig(images=images, fps=10.0, **options)  # type: ignore[arg-type]


def test_what_contradicts_itself_is_named(images: dict[str, str]) -> None:
    with pytest.raises(InputError, match="say of which camera, such as left="):
        cb.rig(images=[images["left"]], target=BOARD)
    with pytest.raises(InputError, match="names one camera, left"):
        cb.rig(images={"left": images["left"]}, target=BOARD)
    with pytest.raises(InputError, match="camera left has no board"):
        cb.rig(images=images)
    with pytest.raises(InputError, match="not both"):
        cb.rig(images=images, target=BOARD, board={"a": BOARD})
    with pytest.raises(InputError, match="needs the time of every picture"):
        cb.rig(images=images, target=BOARD, time_offsets=True)
    with pytest.raises(InputError, match="is a photo of left and of top"):
        cb.rig(images={"left": images["left"], "top": images["left"]}, target=BOARD)
    with pytest.raises(DetectionError, match="camera left: 0 of"):
        cb.rig(images=images, target="chessboard:13x12:30mm")


def test_frames_of_videos_belong_together_by_number(images: dict[str, str], tmp_path: Path) -> None:
    for name, folder in images.items():
        size = CAMERAS[name].image_size
        writer = cv2.VideoWriter(str(tmp_path / f"{name}.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, size)
        if not writer.isOpened():
            pytest.skip("this OpenCV cannot write videos")
        for k in range(FRAMES):
            writer.write(cv2.imread(f"{folder}/{k:02d}.png"))
        writer.release()
    videos = {name: str(tmp_path / f"{name}.avi") for name in images}
    options = {"target": BOARD, "model": ["top:kannala_brandt"], "fix": ["k3"]}
    result = cb.rig(images=videos, **options)  # type: ignore[arg-type]
    assert off_mm(result, "right") < 10
    assert [record["file"] for record in result.inputs] == list(videos.values())
    fewer = cb.rig(images={n: f"{v}@2" for n, v in videos.items()}, camera=[], **options)  # type: ignore[arg-type]
    seen = fewer.observations
    assert seen is not None
    assert all(len({v.id for v in seen.views if v.moment == m}) == 1 for m in {v.moment for v in seen.views})
