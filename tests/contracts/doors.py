"""What the contract over every command's doors runs: for each, files to work on and the options to call it with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from tests.perceive.boxes_on_a_table import Thing, d435, exact_depth, looking_down, photograph

import calibrant as cb
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, RobotPoses, as_transform
from calibrant.geometry import se3, so3
from calibrant.patterns.sequence import PatternSequence
from calibrant.simulate.cell import poses_csv
from calibrant.simulate.manhattan import render_room, room
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.projector.pictures import Lighting, photographed
from calibrant.simulate.projector.points import board_poses, example_pair
from calibrant.simulate.projector.surfaces import Plane
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import gripper_poses, look_at_board, standard_mounting
from calibrant.targets.registry import parse_target

TARGET = "chessboard:7x6:30mm"
VIEWS = 8
Options = Mapping[str, Any]


@dataclass(frozen=True)
class Files:
    """What every case may use: photos of a chessboard by a camera on a gripper, and the robot's poses."""

    folder: Path
    images: Path
    poses: Path
    camera: Path
    """The camera of the photos, as a result file."""


def camera_of_photos() -> Camera:
    """The camera of the photos."""
    terms = {"fx": 430.0, "fy": 428.0, "cx": 241.0, "cy": 178.0, "k1": -0.1}
    return Camera.create("brown", terms, image_size=(480, 360))


def make_files(folder: Path) -> Files:
    """Photos NN.png and poses.csv in the folder."""
    images = folder / "images"
    images.mkdir()
    rng = np.random.default_rng(7)
    camera = camera_of_photos()
    target = parse_target(TARGET)
    T = look_at_board(camera, target.points, VIEWS, rng=rng, distance=(0.35, 0.6), tilt_deg=45)
    for i, T_camera_target in enumerate(T):
        image = render(target.artwork(), camera, T_camera_target, rng=rng, look=Look(clutter=0, noise_grey=2.0))
        cv2.imwrite(str(images / f"{i:02d}.png"), image)
    X, Z = standard_mounting("eye-in-hand")
    robot = noisy_poses(gripper_poses("eye-in-hand", X, Z, T), sigma_mm=0.05, sigma_deg=0.01, rng=rng)
    poses = folder / "poses.csv"
    poses.write_text(poses_csv(RobotPoses.from_matrices(robot, ids=[f"{i:02d}.png" for i in range(VIEWS)])))
    known = folder / "camera.json"
    CalibrationResult("intrinsics", "ok", cameras={"camera": camera}).write(known)
    return Files(folder, images, poses, known)


def _detect(files: Files) -> Options:
    return {"images": [files.images], "target": TARGET}


def _intrinsics(files: Files) -> Options:
    return {"images": [files.images], "target": TARGET, "fix": ["k3"]}


def _hand_eye(files: Files) -> Options:
    return {"images": [files.images], "poses": [files.poses], "target": [TARGET]}


def _doctor(files: Files) -> Options:
    return {"images": [files.images], "poses": [files.poses], "target": TARGET}


def _pose(files: Files) -> Options:
    return {"images": [files.images / "00.png"], "target": TARGET, "camera": files.camera}


def _locate(files: Files) -> Options:
    camera = camera_of_photos()
    T, thing = looking_down(0.25, 20.0), Thing(se3.make(np.eye(3), [0.0, 0.0, 0.02]), np.full(3, 0.04))
    colour, depth = files.folder / "colour.png", files.folder / "depth.png"
    cv2.imwrite(str(colour), photograph(camera, T, [thing], np.random.default_rng(0)))
    z = d435(exact_depth(camera, T, [thing]), np.random.default_rng(1), f_b=21.5)
    cv2.imwrite(str(depth), np.rint(np.nan_to_num(1e3 * z)).astype(np.uint16))
    return {
        "picture": colour,
        "depth": depth,
        "camera": files.camera,
        "object": "cube:40mm",
        "colour": "h:340-20 s:40-100",
    }


def _hand_eye_point(files: Files) -> Options:
    rng = np.random.default_rng(5)
    X = se3.make(so3.exp([2.0, 0.3, -0.4]), [1.2, -0.3, 0.7])
    A = se3.make(so3.exp(rng.uniform(-0.6, 0.6, (12, 3))), np.array([0.5, 0.0, 0.4]) + rng.uniform(-0.2, 0.2, (12, 3)))
    seen = se3.apply(se3.inverse(X), se3.apply(A, np.array([0.01, 0.02, 0.11])))
    # The camera looks along z at what moves before it.
    turn = se3.make(np.linalg.qr(np.column_stack([seen.mean(axis=0), np.eye(3)[:, :2]]))[0][:, [1, 2, 0]], np.zeros(3))
    p = se3.apply(se3.inverse(turn), seen)
    p = p if p[:, 2].mean() > 0 else p * [1, -1, -1]
    poses, points = files.folder / "arm.csv", files.folder / "points.csv"
    names = [f"{i:02d}" for i in range(12)]
    poses.write_text(poses_csv(RobotPoses.from_matrices(A, ids=names)))
    rows = (f"{n},{x:.6f},{y:.6f},{z:.6f}" for n, (x, y, z) in zip(names, p))
    points.write_text("\n".join(["image,x,y,z", *rows]) + "\n")
    return {"poses": [poses], "points": points}


def _verify_depth(files: Files) -> Options:
    """Depth of the board in the first photo, by its pose."""
    from calibrant.calibrate.pose.target_poses import target_poses

    photo = files.images / "00.png"
    view = cb.detect(photo, target=TARGET).views[0]
    camera = camera_of_photos()
    T = target_poses(camera, [view]).T_camera_target[0]
    u, v = np.meshgrid(np.arange(480.0), np.arange(360.0))
    rays = camera.unproject(np.stack([u, v], -1))
    depth = files.folder / "board.npy"
    np.save(depth, (T[:3, 2] @ T[:3, 3]) / ((rays / rays[..., 2:]) @ T[:3, 2]))
    return {"images": [photo], "depth": [depth], "camera": files.camera, "target": TARGET}


def _vanishing(files: Files) -> Options:
    rng = np.random.default_rng(7)
    camera = Camera.create("pinhole", {"fx": 520.0, "fy": 520.0, "cx": 319.5, "cy": 239.5}, image_size=(640, 480))
    photo = files.folder / "room.png"
    cv2.imwrite(str(photo), render_room(room(rng), camera, so3.exp([0.25, 0.4, 0.05]), rng=rng))
    return {"image": photo}


def _capture(files: Files) -> Options:
    return {"camera": str(files.images), "target": TARGET}


def _point(files: Files) -> Options:
    return {
        "left_corners": ["102,340", "160,120", "560,352", "505,122"],
        "left_axis": ["300,60", "322,140"],
        "right_corners": ["80,330", "150,110", "540,360", "500,130"],
        "right_axis": ["210,80", "262,160"],
        "plane": ["600mmx400mm"],
    }


def _pair(files: Files) -> Path:
    """A calibrated pair, as a result file; its pictures need not show the same."""
    camera = cb.read(files.camera).camera
    path = files.folder / "pair.json"
    place = as_transform("left", "right", se3.make(so3.exp([0.0, -0.02, 0.01]), [0.08, 0.0, 0.0]))
    CalibrationResult("rig", "ok", cameras={"left": camera, "right": camera}, transforms=(place,)).write(path)
    return path


def _depth(files: Files) -> Options:
    """A textured wall, parallel to the pictures of a pair."""
    rng = np.random.default_rng(3)
    wall = cv2.GaussianBlur(rng.uniform(0, 255, (360, 520)).astype(np.float32), (0, 0), 1.5) * 3 - 255
    camera = Camera.create("pinhole", {"fx": 430.0, "fy": 430.0, "cx": 239.5, "cy": 179.5}, image_size=(480, 360))
    for name, first in (("left", 10), ("right", 30)):
        cv2.imwrite(str(files.folder / f"{name}.png"), np.clip(wall[:, first : first + 480], 0, 255).astype(np.uint8))
    place = as_transform("left", "right", se3.make(np.eye(3), [0.08, 0.0, 0.0]))
    path = files.folder / "parallel.json"
    CalibrationResult("rig", "ok", cameras={"left": camera, "right": camera}, transforms=(place,)).write(path)
    return {
        "result": path,
        "left": files.folder / "left.png",
        "right": files.folder / "right.png",
    }


def _epipolar(files: Files) -> Options:
    """Matches of two cameras a board's length apart."""
    rng = np.random.default_rng(5)
    camera = cb.read(files.camera).camera
    X = rng.uniform([-0.3, -0.2, 0.8], [0.3, 0.2, 1.6], (60, 3))
    uv = np.concatenate([camera.project(X), camera.project(X - [0.1, 0.0, 0.02])], axis=1)
    table = files.folder / "matches.csv"
    lines = ["u_left,v_left,u_right,v_right", *(",".join(map(repr, row)) for row in uv.tolist())]
    table.write_text("\n".join(lines))
    left, right = (files.images / f"0{i}.png" for i in (0, 1))
    return {"left": left, "right": right, "matches": table, "camera": [files.camera], "baseline": "102mm"}


def _rectify(files: Files) -> Options:
    left, right = ([files.images / f"0{i}.png"] for i in (0, 1))
    out = files.folder / "rectified"
    return {"result": _pair(files), "left": left, "right": right, "out": out, "force": True}


def _projector_calibrate(files: Files) -> Options:
    pair = example_pair(image_size=(480, 360), projector_size=(128, 96))
    points = parse_target(TARGET).points
    rng = np.random.default_rng(7)
    sequence = PatternSequence((128, 96))
    for k, T in enumerate(board_poses(pair, points, 4, rng, distance=(0.5, 0.8))):
        board = Plane(T, half=(0.13, 0.115), squares=(7, 6, 0.03))
        folder = files.folder / "captures" / f"pose{k}"
        folder.mkdir(parents=True, exist_ok=True)
        for name, picture in zip(sequence.names, photographed(pair, board, sequence, rng, Lighting(samples=1))):
            cv2.imwrite(str(folder / name), picture)
    return {"captures": [files.folder / "captures"], "projector_size": "128x96", "target": TARGET}


def _scan(files: Files) -> Options:
    _projector_calibrate(files)
    pair = example_pair(image_size=(480, 360), projector_size=(128, 96))
    known = files.folder / "projector.json"
    cameras = {"camera": pair.camera, "projector": pair.projector}
    place = as_transform("camera", "projector", pair.T_camera_projector)
    CalibrationResult("projector", "ok", cameras=cameras, transforms=(place,)).write(known, force=True)
    return {"result": known, "capture": files.folder / "captures" / "pose0"}


def _undistort(files: Files) -> Options:
    straight = files.folder / "straight"
    return {"images": [files.images / "00.png"], "camera": files.camera, "out": straight, "force": True}


def _verify_unchanged(files: Files) -> Options:
    return {"result": files.camera, "images": [files.images / "00.png"], "target": TARGET}


def _placed(files: Files) -> Options:
    """A hand-eye result, and photos of the board at robot poses."""
    known = files.folder / "hand-eye.json"
    cb.hand_eye(images=files.images, poses=files.poses, target=TARGET, camera=files.camera).write(known)
    return {"result": known, "images": [files.images], "poses": [files.poses], "target": TARGET, "tip": "0,0,120mm"}


def _verify_touch(files: Files) -> Options:
    return {**_placed(files), "touches": [files.poses]}


def _verify_held_out(files: Files) -> Options:
    return {key: value for key, value in _placed(files).items() if key != "tip"}


def _verify_watch(files: Files) -> Options:
    """A camera and a board that stand still, by the first picture, which is the only one."""
    return {"result": files.camera, "images": [files.images / "00.png"], "target": TARGET}


def _stereo(files: Files) -> Options:
    """The photos, and a second camera 80 mm to the right of the first."""
    folder = files.folder / "right"
    folder.mkdir(exist_ok=True)
    rng = np.random.default_rng(7)
    target, camera = parse_target(TARGET), camera_of_photos()
    for i, T in enumerate(look_at_board(camera, target.points, VIEWS, rng=rng, distance=(0.35, 0.6), tilt_deg=45)):
        moved = T.copy()
        moved[0, 3] -= 0.08
        image = render(target.artwork(), camera, moved, rng=rng, look=Look(clutter=0, noise_grey=2.0))
        cv2.imwrite(str(folder / f"{i:02d}.png"), image)
    return {"left": [files.images], "right": [folder], "target": [TARGET], "fix": ["k3"]}


def _rig(files: Files) -> Options:
    """The pair of stereo, by names."""
    pair = _stereo(files)
    images = [f"front={pair['left'][0]}", f"side={pair['right'][0]}"]
    return {"images": images, "target": pair["target"], "fix": pair["fix"], "reference": "side"}


def _convert(files: Files) -> Options:
    return {"source": files.camera, "target": files.folder / "Intr.yml", "to": "opencv", "force": True}


def _compare(files: Files) -> Options:
    return {"first": files.camera, "second": files.camera}


CASES: Mapping[str, Callable[[Files], Options]] = {
    "detect": _detect,
    "intrinsics": _intrinsics,
    "stereo": _stereo,
    "rig": _rig,
    "hand-eye": _hand_eye,
    "doctor": _doctor,
    "pose": _pose,
    "locate": _locate,
    "hand-eye-point": _hand_eye_point,
    "verify depth": _verify_depth,
    "vanishing": _vanishing,
    "capture": _capture,
    "point": _point,
    "rectify": _rectify,
    "epipolar": _epipolar,
    "depth": _depth,
    "projector calibrate": _projector_calibrate,
    "scan": _scan,
    "undistort": _undistort,
    "convert": _convert,
    "compare": _compare,
    "verify unchanged": _verify_unchanged,
    "verify watch": _verify_watch,
    "verify pinpoint": _placed,
    "verify held-out": _verify_held_out,
    "verify touch": _verify_touch,
}
"""Options by command, as Python takes them: a line for every command that gives a result."""
ANSWERS: Mapping[str, Options] = {
    "study methods": {"noise": "0", "lens": "pinhole", "trials": 0, "views": 2},
    "study paper-tables": {},
    "demo": {"views": 6},
    "servo run": {},
    "servo conveyor": {},
    "verify pick-place": {},
    "verify stitch": {},
    **{f"project {word}": {} for word in ("new", "add", "list", "set", "rename", "remove", "solve", "status", "check")},
}
"""Commands whose JSON is more than a result file, or another thing."""
