"""Does `verify unchanged` name what moved, and stay silent where nothing did? Three rendered photos, seeded.

    python benchmarks/verify_unchanged.py [--seeds 100] [--robot 0.05mm,0.01deg] [--only board|picture]

A camera of 640x512 px, a ChArUco board 1 m away. The hand-eye calibration comes from 25 views whose corners have
the noise that the detector has on such photos (0.04 px), and from robot poses with the noise given; the three photos of
now are rendered and detected. Of each seed: nothing changed; the camera pushed by 1 mm in a direction drawn at random;
turned by 0.1 deg about an axis drawn at random. The same three photos serve a camera in the hand and one beside the
robot; three more, of a board that stands, are compared with a reference photo of it. "named": the exit status is 1 and
the camera is among what moved; "first": it is named first; direction: points at the workpiece are said to be off in the
true direction, within 30 deg.

Without a board: a wall in another light with a box before it that was moved, the camera turned so that the picture
moves by 5 px in a direction drawn at random; against the photo of then, and against the copy of 640 px that a result
keeps of a camera of 1280x1024 px. named: exit status 1; right: the direction told is within 22.5 deg of the true one.
"""

from __future__ import annotations

import argparse
from collections import defaultdict

import numpy as np

import calibrant as cb
from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Observations, RobotPoses, View
from calibrant.detection.registry import detector_for
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.simulate.background import clutter
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import gripper_poses, look_at_board, observe, standard_mounting
from calibrant.simulate.wall import photograph_wall, wall
from calibrant.targets.registry import parse_target
from calibrant.tasks.inputs.placement import parse_noise
from calibrant.verification.unchanged.answer import ANY_CHANGE, Answer, answer_of_picture, answer_of_target
from calibrant.verification.unchanged.compare import Compared, on_robot, seen_now, standing
from calibrant.verification.unchanged.decide import CAMERA
from calibrant.verification.unchanged.pictures import Reference, became, kept_reference, record_of
from calibrant.verification.unchanged.robot_noise import robot_side
from calibrant.verification.unchanged.spread import spread_of

BOARD = parse_target("charuco:7x5:55mm:41mm:DICT_5X5_100")
SIGMA_PX = 0.04
VIEWS = 25
CONDITIONS = ("unchanged", "1 mm", "0.1 deg")


def small_camera(scale: float = 1.0) -> Camera:
    size = (round(640 * scale), round(512 * scale))
    centre = {"cx": (size[0] - 1) / 2, "cy": (size[1] - 1) / 2}
    lens = {"fx": 560.0 * scale, "fy": 558.0 * scale, "k1": -0.12, "k2": 0.05}
    return Camera.create("brown", lens | centre, image_size=size)


def pushed(condition: str, rng: np.random.Generator) -> Array:
    d = rng.standard_normal(3)
    d /= np.linalg.norm(d)
    if condition == "1 mm":
        return se3.make(np.eye(3), 1e-3 * d)
    return se3.make(so3.exp(np.deg2rad(0.1) * d), np.zeros(3)) if condition == "0.1 deg" else np.eye(4)


def photo(camera: Camera, T: Array, name: str, rng: np.random.Generator) -> View:
    """A rendered photo of the board, detected."""
    image = render(BOARD.artwork(), camera, T, rng=rng, look=Look(noise_grey=2.0, clutter=30))
    found = detector_for(BOARD.kind).detect(image, BOARD)
    return View(name, BOARD.points[found.point_ids], found.uv, found.point_ids, sigma_px=found.sigma_px)


def direction_off(compared: Compared, D: Array) -> float:
    """Degrees between the told and the true displacement of the workpiece in the picture's plane."""
    h = compared.decision.named(CAMERA)
    p = np.mean([se3.apply(T, compared.middle) for T in compared.expected], axis=0)
    told, true = (se3.apply(se3.inverse(M), p) - p for M in (h.fit.place["camera moved"], D))
    return float(np.rad2deg(np.arccos(np.clip(told @ true / np.linalg.norm(told) / np.linalg.norm(true), -1, 1))))


def board(seeds: int, robot: tuple[float, float], ways: list[str]) -> None:
    counts: dict[tuple[str, str], list[tuple[bool, bool, bool, bool]]] = defaultdict(list)
    camera = small_camera()
    for seed in range(seeds):
        rng = np.random.default_rng([8, seed])
        T = look_at_board(camera, BOARD.points, VIEWS + 3, rng=rng, distance=(0.9, 1.1), tilt_deg=35)
        ids = [f"{i:02d}.png" for i in range(VIEWS + 3)]
        seen = observe(camera, BOARD.points, T[:VIEWS], sigma_px=SIGMA_PX, rng=rng)
        then = Observations.from_points(
            [v.points for v in seen.views], [v.uv for v in seen.views], image_size=camera.image_size, ids=ids[:VIEWS],
            point_ids=[v.point_ids for v in seen.views], target=BOARD.spec,
        )  # fmt: skip
        sides = {}
        for setup in (w for w in ways if w != "standing"):
            X, Z = standard_mounting(setup)
            said = noisy_poses(
                gripper_poses(setup, X, Z, T), sigma_mm=1e3 * robot[0], sigma_deg=np.rad2deg(robot[1]), rng=rng
            )
            poses = RobotPoses.from_matrices(said[:VIEWS], ids=ids[:VIEWS])
            result = cb.calibrate_hand_eye(poses, then, setup=setup)
            sides[setup] = (result, robot_side(result, "camera"), spread_of(result, "camera", result.camera), said)
        stands = None
        if "standing" in ways:
            lens: CalibrationResult = cb.calibrate_intrinsics(then)
            of_lens = spread_of(lens, "camera", lens.camera)
            stands = seen_now(lens.camera, [photo(camera, T[VIEWS], "then.png", rng)])
        for condition in CONDITIONS:
            D = pushed(condition, rng)
            now = (
                []
                if not sides
                else [photo(camera, se3.inverse(D) @ T[VIEWS + k], ids[VIEWS + k], rng) for k in range(3)]
            )
            for setup, (result, side, spread, said) in sides.items():
                found = on_robot(result.camera, side, seen_now(result.camera, now), said[VIEWS:], spread)
                counts[setup, condition].append(told(found, D, condition))
            if stands is None:
                continue
            still = [photo(camera, se3.inverse(D) @ T[VIEWS], f"{k}.png", rng) for k in range(3)]
            seen_still = seen_now(lens.camera, still)
            compared = standing(
                lens.camera, stands.views[0], stands.sigmas[0], stands.T_camera_target[0], seen_still, of_lens
            )
            counts["standing", condition].append(told(compared, D, condition))
        if (seed + 1) % 10 == 0:
            print(
                f"{seed + 1} seeds: "
                + ", ".join(f"{w} {c} {sum(r[1] for r in rows)}" for (w, c), rows in counts.items())
            )
    print("| photos | condition | changed | camera named | first | direction |\n|---|---|---|---|---|---|")
    for (way, condition), rows in counts.items():
        changed, named, first, right = (sum(r[k] for r in rows) for k in range(4))
        print(f"| {way} | {condition} | {changed} | {named} | {first} | {right} of {len(rows)} |")


def told(compared: Compared, D: Array, condition: str) -> tuple[bool, bool, bool, bool]:
    answer: Answer = answer_of_target(compared, None, ANY_CHANGE)
    names = [h.what for h in compared.decision.explaining]
    first = answer.changed and answer.words.startswith("changed: the camera")
    right = condition != "unchanged" and direction_off(compared, D) < 30
    return answer.changed, answer.changed and CAMERA in names, first, right


def picture(seeds: int) -> None:
    print("| reference | picture moved | changed | right | refused | error, px | its mean square over sigma |")
    print("|---|---|---|---|---|---|---|")
    for scale, name in ((1.0, "photo, 640x512"), (2.0, "kept copy of 1280x1024")):
        camera = small_camera(scale)
        for px in (0.0, 5.0):
            changed = right = refused = 0
            errors, ratios = [], []
            for seed in range(seeds):
                rng = np.random.default_rng([9, seed])
                scene = wall(camera, rng=rng)
                box = clutter((round(150 * scale), round(120 * scale)), shapes=15, rng=rng)
                a = rng.uniform(0, 2 * np.pi)
                # The camera turned to the right moves the picture to the left.
                turn = px / camera.parameters["fx"] * np.array([np.sin(a), -np.cos(a), 0.0])
                places = rng.uniform((0, 0), (480 * scale, 380 * scale), size=(2, 2)).astype(int)
                then = photograph_wall(scene, camera, np.eye(4), rng=rng, box=(*places[0], box))
                now = photograph_wall(
                    scene, camera, se3.make(so3.exp(turn), np.zeros(3)), rng=rng, box=(*places[1], box)
                )
                reference = Reference("then.png", then, camera.image_size)
                if scale > 1:
                    reference = kept_reference(record_of(reference))
                try:
                    moved = became(reference, Reference("now.png", now, camera.image_size))
                except InputError as error:
                    refused += 1
                    print(seed, error)
                    continue
                answer = answer_of_picture([moved], camera, None, ANY_CHANGE)
                assert answer is not None
                changed += answer.changed
                off = np.rad2deg(np.arctan2(moved.shift[1], moved.shift[0]) - a)
                right += answer.changed and abs((off + 180) % 360 - 180) < 22.5
                step = moved.shift - px * np.array([np.cos(a), np.sin(a)])
                errors.append(float(np.linalg.norm(step)))
                ratios.append(float(step @ np.linalg.solve(moved.covariance[:2, :2], step)) / 2)
            figures = f"{np.sqrt(np.mean(np.square(errors))):.3f} | {np.mean(ratios):.2f}"
            print(f"| {name} | {px:g} px | {changed} | {right if px else '–'} | {refused} | {figures} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--robot", default="0.05mm,0.01deg")
    parser.add_argument("--only", choices=("board", "picture"))
    parser.add_argument("--ways", nargs="+", default=["eye-in-hand", "eye-to-hand", "standing"])
    asked = parser.parse_args()
    if asked.only != "board":
        picture(asked.seeds)
    if asked.only != "picture":
        board(asked.seeds, parse_noise(asked.robot, what="--robot"), asked.ways)


if __name__ == "__main__":
    main()
