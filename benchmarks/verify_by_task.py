"""What `calibrant verify` promises, measured: watching, pinpoints by drawn corners, and pinpoints and cubes in the
cell.

    python benchmarks/verify_by_task.py watch [--trials 200] [--runs 10]
    python benchmarks/verify_by_task.py points [--trials 400]
    python benchmarks/verify_by_task.py cell [--seeds 20] [--cubes 10]

watch: a hand camera at a robot of 0.1 mm and 0.01 deg, pushed by 1 mm or turned by 0.1 deg in any direction at a
picture: how many are named within ten pictures, and false alarms in runs of 1000 pictures. points: pinpoints of as
many calibrations whose corners are drawn with the noise of detected ones: how many errors are inside the predicted 95
% region. cell: the commands' own `--cell`, which need MuJoCo.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, RobotPoses
from calibrant.geometry import se3, so3
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.scenes import gripper_poses, look_at_board, observe, standard_mounting
from calibrant.targets.registry import parse_target
from calibrant.targets.target import Target
from calibrant.verification.pinpoint.look import marker_pose, mean_view
from calibrant.verification.touch.placing import placed_in_base, touch_of
from calibrant.verification.unchanged.robot_noise import RobotSide, robot_side
from calibrant.verification.watch.placed import at_robot_poses, placed_views
from calibrant.verification.watch.sequential import Rule, Sight, Watch

CAMERA = Camera.create("pinhole", {"fx": 616.7, "fy": 617.0, "cx": 314.2, "cy": 249.5}, image_size=(640, 480))
BOARD, TAG = parse_target("charuco:9x14:40mm:31mm:DICT_5X5_1000"), parse_target("marker:100mm:DICT_5X5_50:7")
X, Z = standard_mounting("eye-in-hand")
ROBOT = {"sigma_mm": 0.1, "sigma_deg": 0.01}
CORNER_PX = 0.06
"""Of a detected corner of rendered pictures, per axis."""
NAMED_WITHIN = 10


def calibrated(rng: np.random.Generator, *, views: int = 18) -> CalibrationResult:
    """A hand camera, calibrated from drawn corners of the large board."""
    T = look_at_board(CAMERA, BOARD.points, views, rng=rng, distance=(0.45, 0.7), tilt_deg=38, roll_deg=90)
    said = noisy_poses(gripper_poses("eye-in-hand", X, Z, T), rng=rng, **ROBOT)
    seen = observe(CAMERA, BOARD.points, T, sigma_px=CORNER_PX, rng=rng)
    return calibrate_hand_eye(RobotPoses.from_matrices(said), seen, setup="eye-in-hand")


def sights(
    known: CalibrationResult, side: RobotSide, n: int, rng: np.random.Generator, D: Array, *, at: int
) -> tuple[Sight, ...]:
    """Pictures of the board at work, the camera moved by D from picture `at` on."""
    T = look_at_board(CAMERA, BOARD.points, n, rng=rng, distance=(0.45, 0.7), tilt_deg=30, roll_deg=90)
    said = noisy_poses(gripper_poses("eye-in-hand", X, Z, T), rng=rng, **ROBOT)
    moved = np.stack([T_i if i < at else se3.inverse(D) @ T_i for i, T_i in enumerate(T)])
    views = observe(CAMERA, BOARD.points, moved, sigma_px=CORNER_PX, rng=rng).views
    placed = placed_views(known.camera, views, side.predicted(said), stated_px=known.sigma_px)
    return at_robot_poses(known.camera, side, placed, said)


def pushed(rng: np.random.Generator, kind: str) -> Array:
    """A push by 1 mm, or a turn by 0.1 deg, in any direction."""
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    if kind == "1 mm":
        return se3.make(np.eye(3), 1e-3 * axis)
    return se3.make(so3.exp(np.deg2rad(0.1) * axis), np.zeros(3))


def watch_table(trials: int, runs: int) -> None:
    rng = np.random.default_rng(0)
    known = [calibrated(rng) for _ in range(5)]
    sides = [robot_side(k, "camera") for k in known]
    for kind in ("1 mm", "0.1 deg"):
        named, late, early, pictures = 0, 0, 0, []
        for trial in range(trials):
            k = trial % len(known)
            state = Watch(Rule(freedom=sides[k].freedom))
            for sight in sights(known[k], sides[k], 12 + NAMED_WITHIN, rng, pushed(rng, kind), at=12):
                state = state.after(sight)
            alarm = state.alarm
            if alarm is None:
                late += 1
            elif alarm.at < 12:
                early += 1
            else:
                named += 1
                pictures.append(alarm.at - 11)
        mean = np.mean(pictures) if pictures else float("nan")
        print(f"pushed by {kind}: named within {NAMED_WITHIN} pictures {named} of {trials} (mean {mean:.1f}), not "
              f"{late}, before it {early}", flush=True)  # fmt: skip
    alarms = 0
    for trial in range(runs):
        k = trial % len(known)
        state = Watch(Rule(freedom=sides[k].freedom))
        for sight in sights(known[k], sides[k], 1000, rng, np.eye(4), at=1000):
            state = state.after(sight)
        alarms += state.alarm is not None
    print(f"runs of 1000 pictures with a false alarm: {alarms} of {runs} (stated: 1 in 100 at most)", flush=True)


def points_table(trials: int) -> None:
    rng, inside, errors, predicted, turns = np.random.default_rng(1), 0, [], [], []
    tip = np.array([0.0, 0.0, 0.17])
    for _ in range(trials):
        known = calibrated(rng)
        side = robot_side(known, "camera")
        truth = Z
        T = look_at_board(CAMERA, TAG.points, 1, rng=rng, distance=(0.33, 0.36), tilt_deg=4, roll_deg=180)[0]
        stands = truth @ se3.inverse(X @ T)
        said = noisy_poses(stands[None], rng=rng, **ROBOT)[0]
        seen = [observe(CAMERA, TAG.points, T[None], sigma_px=CORNER_PX, rng=rng).views[0] for _ in range(5)]
        views = [replace(v, sigma_px=np.full(len(v), CORNER_PX)) for v in seen]
        placed = marker_pose(known.camera, mean_view(views), (said @ side.X)[:3, :3])
        placing = placed_in_base(known.camera, side, placed, said)
        middle = _middle(TAG)
        where, _ = placing.at(middle)
        goal = se3.make(so3.exp([np.pi, 0, 0]), where - so3.exp([np.pi, 0, 0]) @ tip)
        real = noisy_poses(goal[None], rng=rng, **ROBOT)[0]
        touched = where - (se3.apply(real, tip) - se3.apply(truth, middle))
        touch = touch_of(placing, side, middle, touched=touched, tip=tip, T_base_gripper=goal, sigma=0.0)
        inside += touch.inside
        errors.append(1e3 * np.linalg.norm(touch.error))
        predicted.append(1e3 * touch.predicted_95)
        turns.append(np.mean(np.array(errors) < np.array(predicted)))
    print(f"pinpoints by drawn corners: {inside} of {trials} inside the 95 % region ({100 * inside / trials:.1f} %), "
          f"{100 * turns[-1]:.1f} % below the 95 % radius; median {np.median(errors):.2f} mm, predicted (95 %) "
          f"{np.median(predicted):.2f} mm")  # fmt: skip


def _middle(target: Target) -> Array:
    return 0.5 * (target.points.min(axis=0) + target.points.max(axis=0))


def cell_table(seeds: int, cubes: int) -> None:
    import calibrant as cb
    from calibrant.data.details import TaskRuns
    from calibrant.verification.runs import inside_95, median_mm

    for view in ("wrist", "front", "top"):
        start = time.perf_counter()
        found = cb.verify_pinpoint(cell=True, view=view, seeds=seeds).detail(TaskRuns)
        if found is None:
            continue
        inside, of = inside_95(found.runs)
        before, after = median_mm(found.runs), median_mm(found.runs, after=True)
        turn = np.median([r.after_deg for r in found.runs if r.after_deg is not None])
        print(f"pinpoint {view}: {before:.2f} mm, inside {inside} of {of}; corrected {after:.2f} mm, {turn:.3f} deg "
              f"({time.perf_counter() - start:.0f} s)", flush=True)  # fmt: skip
    for view in ("wrist", "front", "top"):
        found = cb.verify_pick_place(cell=True, view=view, seeds=max(seeds // 10, 1), cubes=cubes).detail(TaskRuns)
        if found is not None:
            done = sum(r.passed for r in found.runs)
            print(f"pick and place {view}: {done} of {len(found.runs)}; {dict(found.beside)}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("watch", "points", "cell"))
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--cubes", type=int, default=10)
    given = parser.parse_args()
    if given.what == "watch":
        watch_table(given.trials, given.runs)
    elif given.what == "points":
        points_table(given.trials)
    else:
        cell_table(given.seeds, given.cubes)


if __name__ == "__main__":
    main()
