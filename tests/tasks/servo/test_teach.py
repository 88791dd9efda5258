"""`servo teach`: what was seen goes into the target file and comes back; stereo gives what the camera then sees."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.servoing.cells import CAMERA

import calibrant as cb
from calibrant.data import CalibrationResult, as_transform
from calibrant.data.details import TaughtFeatures
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.servoing.teach import features_from
from calibrant.simulate.render import render
from calibrant.targets.registry import parse_target
from calibrant.tasks.servo.run import percent
from calibrant.tasks.servo.teach import degrees

SPEC = "charuco:7x5:30mm:22mm:DICT_4X4_50"
HAND = se3.make(so3.exp([0.0, 0.0, 0.3]), [0.03, -0.06, 0.04])


def photo(path: Path, T_camera_target: np.ndarray, seed: int = 0) -> Path:
    board = parse_target(SPEC)
    cv2.imwrite(str(path), render(board.artwork(), CAMERA, T_camera_target, rng=np.random.default_rng(seed)))
    return path


def facing(distance: float, turn: tuple[float, float, float] = (0.05, -0.1, 0.2)) -> np.ndarray:
    R = so3.exp(turn)
    return se3.make(R, np.array([0, 0, distance]) - R @ parse_target(SPEC).points.mean(axis=0))


def known(folder: Path) -> Path:
    place = (as_transform("gripper", "camera", HAND, 1e-8 * np.eye(6)),)
    return CalibrationResult("hand-eye", "ok", cameras={"camera": CAMERA}, transforms=place, sigma_px=0.1).write(
        folder / "hand-eye.json"
    )


def test_pictures_of_one_place_are_taught_and_come_back(tmp_path: Path) -> None:
    T = facing(0.35)
    files = [photo(tmp_path / f"{k}.png", T, seed=k) for k in range(3)]
    result = cb.servo_teach(known(tmp_path), images=files, target=SPEC)
    assert result is not None
    record = cb.read(result.write(tmp_path / "target.json")).detail(TaughtFeatures)
    assert record is not None
    assert record.pictures == 3
    wanted = features_from(record, CAMERA)
    truth = CAMERA.project(se3.apply(T, parse_target(SPEC).points))
    rows = {int(i): k for k, i in enumerate(parse_target(SPEC).point_ids)}
    seen = truth[[rows[int(i)] for i in wanted.ids]]
    assert len(wanted) == len(truth)
    assert np.abs(wanted.uv - seen).max() < 0.15
    mm, deg = se3.deviation(T, wanted.T_camera_target)
    assert mm < 0.5
    assert deg < 0.1
    assert "converges" in result.check("stability").message
    assert result.figures["wanted position"].sigma < 0.2


def test_pictures_of_two_places_are_seen_to_be(tmp_path: Path) -> None:
    files = [photo(tmp_path / f"{k}.png", facing(0.35 + 0.01 * k)) for k in range(2)]
    result = cb.servo_teach(known(tmp_path), images=files, target=SPEC)
    assert result is not None
    assert result.check("features").status == "warn"


def test_stereo_tells_what_the_camera_will_see(tmp_path: Path) -> None:
    T_left_target = facing(0.5, (0.2, 0.3, 0.1))
    T_left_right = se3.make(so3.exp([0, -0.2, 0]), [0.12, 0.0, 0.01])
    left = photo(tmp_path / "left.png", T_left_target)
    right = photo(tmp_path / "right.png", se3.inverse(T_left_right) @ T_left_target)
    place = (as_transform("left", "right", T_left_right),)
    rig = CalibrationResult("stereo", "ok", cameras={"left": CAMERA, "right": CAMERA}, transforms=place, sigma_px=0.1)
    result = cb.servo_teach(
        known(tmp_path), target=SPEC, rig=rig.write(tmp_path / "rig.json"), left=left, right=right, stand_off="300mm"
    )
    assert result is not None
    record = result.detail(TaughtFeatures)
    assert record is not None
    wanted = features_from(record, CAMERA)
    # As the camera sees the board from 300 mm, straight on, its x along the row.
    straight = se3.make(np.eye(3), np.array([0, 0, 0.3]) - parse_target(SPEC).points.mean(axis=0))
    rows = {int(i): k for k, i in enumerate(parse_target(SPEC).point_ids)}
    seen = CAMERA.project(se3.apply(straight, parse_target(SPEC).points[[rows[int(i)] for i in wanted.ids]]))
    assert len(wanted) == len(rows)
    # 0.1 px of each camera at 0.5 m and a base of 0.12 m: 0.5 mm along the sight, 1 px from 0.3 m at the border.
    assert np.abs(wanted.uv - seen).max() < 1.5
    assert np.all(np.abs(wanted.uv - seen).mean(axis=0) < 0.5)
    mm, deg = se3.deviation(straight, wanted.T_camera_target)
    assert mm < 1.0
    assert deg < 0.3


def test_what_cannot_be_taught_is_named(tmp_path: Path) -> None:
    file = photo(tmp_path / "a.png", facing(0.35))
    empty = tmp_path / "empty.png"
    cv2.imwrite(str(empty), np.full((480, 640), 128, np.uint8))
    hand = known(tmp_path)
    with pytest.raises(InputError, match="nothing to teach by"):
        cb.servo_teach(hand, target=SPEC)
    with pytest.raises(InputError, match="0 of 1 boards found"):
        cb.servo_teach(hand, images=[empty], target=SPEC)
    with pytest.raises(InputError, match=r"stand.off"):
        cb.servo_teach(hand, target=SPEC, rig=hand, left=file, right=file)
    alone = CalibrationResult("intrinsics", "ok", cameras={"camera": CAMERA}).write(tmp_path / "camera.json")
    with pytest.raises(InputError, match="hand-eye result"):
        cb.servo_teach(alone, images=[file], target=SPEC)
    apart = se3.make(np.eye(3), [0.1, 0.0, 0.0])
    place = (as_transform("left", "right", apart),)
    pair = CalibrationResult("stereo", "ok", cameras={"left": CAMERA, "right": CAMERA}, transforms=place)
    rig, T = pair.write(tmp_path / "pair.json"), facing(0.5)
    left, right = photo(tmp_path / "b.png", T), photo(tmp_path / "c.png", se3.inverse(apart) @ T)
    with pytest.raises(RefusedError, match="stand farther away"):
        cb.servo_teach(hand, target=SPEC, rig=rig, left=left, right=right, stand_off="60mm")


def test_units_are_asked_for() -> None:
    assert degrees("30deg", option="--turn") == 30.0
    assert percent("10%", option="--focal-error") == pytest.approx(0.1)
    for wrong in ("30", "x deg", "infdeg"):
        with pytest.raises(InputError, match="--turn"):
            degrees(wrong, option="--turn")
    for wrong in ("10", "120%", "-1%"):
        with pytest.raises(InputError, match="--focal-error"):
            percent(wrong, option="--focal-error")
