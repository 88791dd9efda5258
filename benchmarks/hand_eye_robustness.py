"""`calibrant hand-eye` on random simulated sets, run as a user would: what crashes, what is wrong without a word?

    python benchmarks/hand_eye_robustness.py                    300 sets
    python benchmarks/hand_eye_robustness.py --first 40 --sets 20 --show

Every set is drawn from its number alone: camera on the gripper or beside the robot, two cameras on one robot, two
robots before one camera; 3 to 60 poses; 0.02 to 2 px, 0 to 3 mm and 0 to 1 degree of noise; intrinsics known or not;
the setup said or not; four kinds of board; ordinary motions or nearly degenerate ones; one to three wrong poses, or one
misread image. A fifth of the sets with one camera are rendered photos, which the command searches; the others give it
points. Sets of even number go through the command, called with its arguments in this process, and its result file is
read; those of odd number through `cb.calibrate_cell`, where no doctor stands in front and the setup is said: every
second of these with one camera is told the wrong setup, and an answer to it counts as wrong.

A set is wrong when a component of the camera's transform (rotation vector or position) is off by more than 4 of its
stated sigma, and silent when no check says so. Passes without crashes and without silently wrong sets.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calibrant.calibrate.cell.calibrate import calibrate_cell
from calibrant.calibrate.cell.problem.layout import Pictures
from calibrant.cameras import Camera
from calibrant.cli.application import run
from calibrant.data import CalibrationResult, Observations, RobotPoses, View
from calibrant.data.result_file import read_result, write_observations
from calibrant.detection.pipeline import detect
from calibrant.errors import CalibrantError
from calibrant.formats.cameras.opencv import write_intrinsics
from calibrant.geometry import se3, so3
from calibrant.simulate.cell import poses_csv
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import Setup, gripper_poses, look_at_board, observe, standard_mounting
from calibrant.targets.registry import parse_target

Array = NDArray[np.float64]

BOARDS = (
    "chessboard:9x6:30mm",
    "charuco:8x6:30mm:22mm:DICT_5X5_100",
    "aprilgrid:5x4:45mm:0.3:36h11",
    "circles:9x7:30mm",
)
LAYOUTS = ("eye-in-hand", "eye-to-hand", "two cameras", "two robots")
MOTIONS = ("free", "axes within 10°", "turns below 10°", "five joints", "SCARA")
FAULTS = ("none", "1-3 bad poses", "bad image")
LIMIT_SIGMAS = 4.0
OFF_MM, OFF_DEG = 60.0, 12.0
"""A bad pose is off by this much at least: what a robot reports that had not arrived yet."""
SETS_OF_TWO = ("two cameras", "two robots")
OTHER: dict[Setup, Setup] = {"eye-in-hand": "eye-to-hand", "eye-to-hand": "eye-in-hand"}
SIZE = (640, 480)
T_LEFT_RIGHT = se3.make(so3.exp([0.0, -0.08, 0.02]), [0.06, 0.0, 0.0])
T_BASE_OTHER = se3.make(so3.exp([0.0, 0.0, 3.0]), [1.1, 0.1, 0.0])


@dataclass(frozen=True)
class Case:
    """What a set is made of."""

    number: int
    layout: str
    motion: str
    fault: str
    board: str
    poses: int
    px: float
    mm: float
    deg: float
    camera_known: bool
    photos: bool
    setup_said: bool

    @property
    def by_cell(self) -> bool:
        """Whether the set goes through `calibrate_cell`, not the command."""
        return self.number % 2 == 1

    @property
    def wrong_setup(self) -> bool:
        """Whether the setup that is said is the other one."""
        return self.number % 4 == 3 and self.layout not in SETS_OF_TWO

    def __str__(self) -> str:
        lens = "camera known" if self.camera_known else "camera unknown"
        return (
            f"{self.number}: {self.layout}, {self.motion}, {self.fault}, {self.board}, {self.poses} poses, "
            f"{self.px:.2g} px, {self.mm:.2g} mm, {self.deg:.2g} deg, {lens}{', photos' if self.photos else ''}"
            f"{'' if self.setup_said or self.by_cell else ', --setup auto'}"
            f"{', by calibrate_cell' if self.by_cell else ''}{', wrong setup said' if self.wrong_setup else ''}"
        )


@dataclass(frozen=True)
class Outcome:
    """What became of a set. worst: largest error over its sigma; normalised: e^T C^-1 e / 6."""

    case: Case
    status: int
    words: str
    warned: tuple[str, ...] = ()
    worst: float = float("nan")
    normalised: float = float("nan")
    seconds: float = 0.0

    @property
    def crashed(self) -> bool:
        return self.status not in (0, 1, 2) or "internal error" in self.words or "Warning" in self.words

    @property
    def refused(self) -> bool:
        return not self.crashed and self.status != 0

    @property
    def wrong(self) -> bool:
        return self.status == 0 and not self.worst <= LIMIT_SIGMAS

    @property
    def silent(self) -> bool:
        return self.wrong and not self.warned


def draw(number: int) -> Case:
    """The set of that number."""
    rng = np.random.default_rng([41, number])
    layout = str(rng.choice(LAYOUTS, p=[0.4, 0.36, 0.12, 0.12]))
    motion = str(rng.choice(MOTIONS, p=[0.6, 0.1, 0.1, 0.1, 0.1]))
    if layout != "eye-in-hand" and motion == "five joints":
        motion = "free"
    fault = str(rng.choice(FAULTS, p=[0.6, 0.25, 0.15]))
    poses = int(np.rint(np.exp(rng.uniform(np.log(3), np.log(60)))))
    photos = layout not in SETS_OF_TWO and bool(rng.random() < 0.2)
    exact = rng.random(2) < 0.1
    px = float(np.exp(rng.uniform(np.log(0.02), np.log(2.0))))
    mm = 0.0 if exact[0] else float(np.exp(rng.uniform(np.log(0.01), np.log(3.0))))
    deg = 0.0 if exact[1] else float(np.exp(rng.uniform(np.log(0.003), np.log(1.0))))
    board, known = str(rng.choice(BOARDS)), bool(rng.random() < 0.5)
    poses = min(poses, 15) if photos else poses
    return Case(number, layout, motion, fault, board, poses, px, mm, deg, known, photos, bool(rng.random() < 0.5))


def lens() -> Camera:
    """A camera of 640 x 480 with a little distortion."""
    terms = {"fx": 552.0, "fy": 550.5, "cx": 322.1, "cy": 236.4, "k1": -0.11, "k2": 0.06, "p1": 4e-4, "p2": -3e-4}
    return Camera.create("brown", terms | {"k3": 0.0}, image_size=SIZE)


def target_poses(case: Case, points: Array, X: Array, Z: Array, rng: np.random.Generator) -> Array:
    """True T_camera_target (n, 4, 4) of one robot's motion."""
    n, camera = case.poses, lens()
    if case.motion == "free":
        return look_at_board(camera, points, n, rng=rng, distance=(0.45, 0.9), tilt_deg=35)
    if case.motion == "five joints":
        return _seen(n, camera, points, lambda m: _five_joints(m, X, Z, rng))
    axis = so3.exp(np.deg2rad(rng.uniform(-30, 30, 3)))[:, 2]
    if case.motion == "turns below 10°":
        turns = rng.normal(size=(8 * n, 3))
        turns *= np.deg2rad(rng.uniform(0, 5, (8 * n, 1))) / np.linalg.norm(turns, axis=1, keepdims=True)
    else:
        spread = np.deg2rad(10.0) if case.motion == "axes within 10°" else 0.0
        axes = axis + spread * rng.uniform(-1, 1, (8 * n, 3)) / np.sqrt(3)
        turns = axes / np.linalg.norm(axes, axis=1, keepdims=True) * rng.uniform(-1.0, 1.0, (8 * n, 1))
    R = so3.exp(turns) @ so3.exp(np.deg2rad(rng.uniform(-20, 20, 3)))
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))

    def place(m: int) -> Array:
        chosen = R[rng.integers(0, len(R), m)]
        centre = rng.uniform((-0.1, -0.08, 0.55), (0.1, 0.08, 0.85), size=(m, 3))
        return se3.make(chosen, centre - chosen @ middle)

    return _seen(n, camera, points, place)


def _five_joints(n: int, X: Array, Z: Array, rng: np.random.Generator) -> Array:
    """Base, shoulder, elbow, wrist pitch and roll: the tool leans in the vertical plane through the base alone."""
    azimuth = np.arctan2(Z[1, 3], Z[0, 3]) + rng.uniform(-0.3, 0.3, n)
    lean, roll = np.pi + rng.uniform(-0.4, 0.4, n), rng.uniform(-np.pi, np.pi, n)
    up, across = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    R = so3.exp(azimuth[:, None] * up) @ so3.exp(lean[:, None] * across) @ so3.exp(roll[:, None] * up)
    reach = rng.uniform(0.4, 0.8, n)
    t = np.column_stack([reach * np.cos(azimuth), reach * np.sin(azimuth), rng.uniform(0.45, 0.85, n)])
    return se3.inverse(X) @ se3.inverse(se3.make(R, t)) @ Z


def _seen(n: int, camera: Camera, points: Array, place: Callable[[int], Array]) -> Array:
    """The first n of many poses whose board is in the image, seen from its face."""
    kept: list[Array] = []
    while sum(map(len, kept)) < n:
        T = place(50 * n)
        p = se3.apply(T[:, None], points)
        uv = camera.project(p)
        with np.errstate(invalid="ignore"):
            inside = np.all((uv > 3) & (uv < np.array(SIZE) - 4), axis=(1, 2)) & (p[..., 2] > 0.2).all(axis=1)
        facing = np.einsum("ni,ni->n", T[:, :3, 2], p.mean(axis=1)) > 0.5 * np.linalg.norm(p.mean(axis=1), axis=1)
        kept.append(T[inside & facing])
    return np.concatenate(kept)[:n]


@dataclass(frozen=True, eq=False)
class Files:
    """The command's arguments, the truth (the frames of the camera's transform, and its value), and the same data for
    `calibrate_cell`; photos are searched when they are asked for."""

    arguments: list[str]
    parent: str
    child: str
    truth: Array
    robots: dict[str, RobotPoses]
    pictures: tuple[Pictures, ...]


def reported(case: Case, T_base_gripper: Array, rng: np.random.Generator) -> Array:
    """What the robot says: its poses with their noise, and the wrong ones."""
    A = noisy_poses(T_base_gripper, sigma_mm=case.mm, sigma_deg=case.deg, rng=rng)
    if case.fault == "1-3 bad poses":
        for k in rng.choice(len(A), size=min(int(rng.integers(1, 4)), max(len(A) // 4, 1)), replace=False):
            axis, way = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
            size = rng.uniform(1, 3)
            A[k] = se3.retract(A[k], size * np.concatenate([np.deg2rad(OFF_DEG) * axis, 1e-3 * OFF_MM * way]))
    return A


def seen_points(case: Case, points: Array, B: Array, rng: np.random.Generator) -> list[View]:
    """Points as a detector hands them back; in a bad image half of them are off by many pixels."""
    views = list(observe(lens(), points, B, sigma_px=case.px, rng=rng).views)
    if case.fault == "bad image":
        k = int(rng.integers(len(views)))
        uv = views[k].uv.copy()
        off = rng.random(len(uv)) < 0.5
        uv[off] += rng.normal(scale=15.0, size=(int(off.sum()), 2))
        views[k] = replace(views[k], uv=np.clip(uv, 0, np.array(SIZE) - 1))
    return views


def write_poses(path: Path, names: Sequence[str], A: Array) -> None:
    path.write_text(poses_csv(RobotPoses.from_matrices(A, ids=list(names))), encoding="utf-8")


def said(case: Case, setup: Setup) -> list[str]:
    """The setup as an argument, or nothing where the data are to tell."""
    return ["--setup", setup] if case.setup_said else []


def one_camera(case: Case, folder: Path, rng: np.random.Generator) -> Files:
    setup: Setup = "eye-to-hand" if case.layout == "eye-to-hand" else "eye-in-hand"
    target, (X, Z) = parse_target(case.board), mounting(setup, rng)
    B = target_poses(case, target.points, X, Z, rng)
    names = [f"{i:02d}.png" for i in range(case.poses)]
    A = reported(case, gripper_poses(setup, X, Z, B), rng)
    write_poses(folder / "poses.csv", names, A)
    if case.photos:
        photograph(case, folder, names, B, rng)
        source = ["--images", str(folder / "photos"), "--target", case.board]
        seen = detect([str(folder / "photos")], target=case.board) if case.by_cell else None
    else:
        views = seen_points(case, target.points, B, rng)
        views = [replace(v, id=name, moment=name) for v, name in zip(views, names)]
        seen = Observations(tuple(views), {"camera": SIZE}, target=target.spec)
        write_observations(seen, folder / "seen.json")
        source = ["--observations", str(folder / "seen.json")]
    parent = "gripper" if setup == "eye-in-hand" else "base"
    told = OTHER[setup] if case.wrong_setup else setup
    pictures = () if seen is None else (Pictures("camera", told, seen),)
    robots = {"robot": RobotPoses.from_matrices(A, ids=names)}
    arguments = [*source, "--poses", str(folder / "poses.csv"), *said(case, setup)]
    return Files(arguments, parent, "camera", X, robots, pictures)


def photograph(case: Case, folder: Path, names: Sequence[str], B: Array, rng: np.random.Generator) -> None:
    """Photos with grey noise and blur by the set's noise of pixels; the bad one is half covered."""
    artwork = parse_target(case.board).artwork()
    look = Look(blur_px=0.7, noise_grey=1.0 + min(20.0 * case.px, 12.0), clutter=0)
    (folder / "photos").mkdir()
    for i, (name, T) in enumerate(zip(names, B)):
        image = render(artwork, lens(), T, rng=rng, look=look)
        if case.fault == "bad image" and i == 0:
            image[:, : SIZE[0] // 2] = 128
        cv2.imwrite(str(folder / "photos" / name), image)


def mounting(setup: Setup, rng: np.random.Generator) -> tuple[Array, Array]:
    """An ordinary cell, a little different each time."""
    X, Z = standard_mounting(setup)
    spread = np.repeat([0.1, 0.02], 3)
    return se3.retract(X, spread * rng.standard_normal(6)), se3.retract(Z, spread * rng.standard_normal(6))


def several(case: Case, folder: Path, rng: np.random.Generator) -> Files:
    """Two cameras on the gripper of one robot, or two robots that bring a board each before one camera."""
    points = parse_target(case.board).points
    arguments: list[str] = []
    if case.layout == "two cameras":
        X, Z = mounting("eye-in-hand", rng)
        B = target_poses(case, points, X, Z, rng)
        names = [f"{i:02d}" for i in range(case.poses)]
        A = reported(case, gripper_poses("eye-in-hand", X, Z, B), rng)
        write_poses(folder / "poses.csv", [f"{n}.png" for n in names], A)
        pictures = []
        for camera, seen, mine in (
            ("left", B, case),
            ("right", se3.inverse(T_LEFT_RIGHT) @ B, replace(case, fault="none")),
        ):
            views = seen_points(mine, points, seen, rng)
            write_seen(folder, camera, views, names)
            pictures.append(Pictures(camera, "eye-in-hand", as_observations(views, names)))
            arguments += [
                "--images",
                f"{camera}={folder / camera}",
                "--target",
                f"{camera}=points:{folder / camera}:unit=m",
            ]
        arguments += ["--poses", str(folder / "poses.csv"), *said(case, "eye-in-hand")]
        robots = {"robot": RobotPoses.from_matrices(A, ids=names)}
        return Files(arguments, "gripper", "left", X, robots, tuple(pictures))
    X, Z = mounting("eye-to-hand", rng)
    robots, pictures = {}, []
    for robot, T_root_base in (("a", np.eye(4)), ("b", T_BASE_OTHER)):
        B = target_poses(case, points, X, Z, rng)
        A = se3.inverse(T_root_base) @ gripper_poses("eye-to-hand", X, Z, B)
        names = [f"{robot}{i:02d}" for i in range(case.poses)]
        mine = case if robot == "a" else replace(case, fault="none")
        A = reported(mine, A, rng)
        write_poses(folder / f"{robot}.csv", [f"{n}.png" for n in names], A)
        views = seen_points(mine, points, B, rng)
        write_seen(folder, "top", views, names)
        robots[robot] = RobotPoses.from_matrices(A, ids=names)
        pictures.append(Pictures("top", "eye-to-hand", as_observations(views, names), robot))
        arguments += ["--images", f"top@{robot}={folder}/top/{robot}*.png", "--poses", f"{robot}={folder / robot}.csv"]
    arguments += ["--target", f"points:{folder / 'top'}:unit=m"]
    return Files([*arguments, *said(case, "eye-to-hand")], "a_base", "top", X, robots, tuple(pictures))


def as_observations(views: Sequence[View], names: Sequence[str]) -> Observations:
    """Views that are called as the poses are."""
    return Observations(tuple(replace(v, id=n, moment=n) for v, n in zip(views, names)), {"camera": SIZE})


def write_seen(folder: Path, name: str, views: Sequence[View], names: Sequence[str]) -> None:
    """Points in a file beside an image that shows nothing, as 3D-EasyCalib keeps them."""
    (folder / name).mkdir(exist_ok=True)
    blank = cv2.imencode(".png", np.zeros(SIZE[::-1], dtype=np.uint8))[1].tobytes()
    for view, n in zip(views, names):
        (folder / name / f"{n}.png").write_bytes(blank)
        store = cv2.FileStorage(str(folder / name / f"{n}.yml"), cv2.FILE_STORAGE_WRITE)
        store.write("corners", view.uv.astype(np.float64))
        store.write("obj", np.asarray(view.points, dtype=np.float64))
        store.release()


def examine(case: Case) -> Outcome:
    """Write the set's files, run the command, judge its result."""
    rng = np.random.default_rng([42, case.number])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = several(case, folder, rng) if case.layout in SETS_OF_TWO else one_camera(case, folder, rng)
        if case.by_cell:
            return examine_by_cell(case, files)
        arguments = ["hand-eye", *files.arguments, "--out", str(folder / "result.json"), "--quiet", "--workers", "1"]
        if case.camera_known:
            write_intrinsics(lens(), folder / "camera.yml")
            cameras = ("left=", "right=") if case.layout == "two cameras" else ("",)
            for camera in cameras:
                arguments += ["--camera", f"{camera}{folder / 'camera.yml'}"]
        start, words = time.perf_counter(), io.StringIO()
        with contextlib.redirect_stderr(words), contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("always")
            status = run(arguments)
        seconds, text = time.perf_counter() - start, words.getvalue()
        if status != 0:
            return Outcome(case, status, text, seconds=seconds)
        return judged(case, files, read_result(folder / "result.json"), text, seconds)


def examine_by_cell(case: Case, files: Files) -> Outcome:
    """The set through `calibrate_cell`; a refusal has the command's status."""
    known = {p.camera: lens() for p in files.pictures} if case.camera_known else {}
    start = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            result = calibrate_cell(files.robots, files.pictures, cameras=known)
    except CalibrantError as error:
        return Outcome(case, 1, str(error), seconds=time.perf_counter() - start)
    except Exception:  # noqa: BLE001 - what a user would see as a traceback is what this benchmark looks for
        return Outcome(case, 3, traceback.format_exc(), seconds=time.perf_counter() - start)
    seconds = time.perf_counter() - start
    if case.wrong_setup:
        warned = tuple(c.name for c in result.checks if c.status != "ok")
        return Outcome(case, 0, "the wrong setup was answered", warned, float("inf"), float("inf"), seconds)
    return judged(case, files, result, "", seconds)


def judged(case: Case, files: Files, result: CalibrationResult, words: str, seconds: float) -> Outcome:
    found = result.transform(files.parent, files.child)
    C = np.asarray(found.covariance)
    e = se3.local(files.truth, found.matrix)
    warned = tuple(c.name for c in result.checks if c.status != "ok")
    worst = float(np.max(np.abs(e) / np.sqrt(np.maximum(np.diag(C), 1e-30))))
    return Outcome(case, 0, words, warned, worst, float(e @ np.linalg.pinv(C, hermitian=True) @ e) / 6, seconds)


def table(outcomes: Sequence[Outcome]) -> str:
    rows = [
        "| sets | number | refused | warned | crashed | wrong, said | wrong, silent | chi²/6 median | mean of 95 % |",
        "|---" * 9 + "|",
    ]
    groups: list[tuple[str, Callable[[Case], bool]]] = [("all", lambda c: True)]
    groups += [(name, lambda c, name=name: c.layout == name) for name in LAYOUTS]  # type: ignore[misc]
    groups += [(name, lambda c, name=name: c.motion == name) for name in MOTIONS]  # type: ignore[misc]
    groups += [(f"fault: {name}", lambda c, name=name: c.fault == name) for name in FAULTS]  # type: ignore[misc]
    groups += [("camera known", lambda c: c.camera_known), ("camera unknown", lambda c: not c.camera_known)]
    groups += [("by command", lambda c: not c.by_cell), ("by calibrate_cell", lambda c: c.by_cell)]
    groups += [("wrong setup said", lambda c: c.wrong_setup)]
    groups += [("3 to 5 poses", lambda c: c.poses <= 5), ("photos", lambda c: c.photos)]
    for name, belongs in groups:
        some = [o for o in outcomes if belongs(o.case)]
        done = np.sort([o.normalised for o in some if o.status == 0 and np.isfinite(o.normalised)])
        median, mean = (np.median(done), done[: int(np.ceil(0.95 * len(done)))].mean()) if len(done) else (np.nan,) * 2
        refused, warned = sum(o.refused for o in some), sum(bool(o.warned) for o in some)
        told = sum(o.wrong and not o.silent for o in some)
        rows.append(
            f"| {name} | {len(some)} | {refused} | {warned} | {sum(o.crashed for o in some)} | {told} "
            f"| {sum(o.silent for o in some)} | {median:.2f} | {mean:.2f} |"
        )
    return "\n".join(rows)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=300)
    parser.add_argument("--first", type=int, default=0, help="number of the first set")
    parser.add_argument("--show", action="store_true", help="a line for every set, not for those that fail alone")
    given = parser.parse_args()
    outcomes = []
    for number in range(given.first, given.first + given.sets):
        case = draw(number)
        outcome = examine(case)
        outcomes.append(outcome)
        if given.show or outcome.crashed or outcome.wrong:
            said = outcome.words.strip() or ", ".join(outcome.warned) or "nothing said"
            figures = f"status {outcome.status}, worst {outcome.worst:.1f} sigma, chi²/6 {outcome.normalised:.2f}"
            print(f"{case}\n    {figures}, {outcome.seconds:.1f} s: {said}", flush=True)
    print(table(outcomes))
    return 1 if any(o.crashed or o.silent for o in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
