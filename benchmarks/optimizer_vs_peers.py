"""Speed of calibration against OpenCV 4.14, OpenCV 5.0 and mrcal 2.2, on the scene of ../shared/PEERS.md.

    python benchmarks/optimizer_vs_peers.py                     everything, medians of five
    python benchmarks/optimizer_vs_peers.py --views 20 100 --repeats 3 --skip extended rig

Peers run in their own Python, one after the other in every round, so that a busy machine slows all of them alike:
what counts are the ratios of medians within one run.
OpenCV goes into virtual environments below the cache folder (made on the first run with pip); mrcal is Debian's:
apt-get install python3-mrcal. What is absent is skipped and said.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

PEER_SCRIPT = Path(__file__).with_name("parts") / "optimizer_peers.py"
CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "calibrant-benchmarks"
OPENCV = {"OpenCV 4.14": "4.14", "OpenCV 5.0": "5.0"}
Row = dict[str, Any]


def opencv_python(version: str) -> Path | None:
    """The Python of an environment with that OpenCV, made on the first call; None when it cannot be made."""
    folder = CACHE / f"opencv-{version}"
    python = folder / "bin" / "python"
    check = [str(python), "-c", f"import cv2; assert cv2.__version__.startswith('{version}')"]
    if not python.exists() or subprocess.run(check, capture_output=True, check=False).returncode:
        print(f"installing OpenCV {version} into {folder} …")
        venv.create(folder, with_pip=True)
        install = [str(python), "-m", "pip", "install", "-q", f"opencv-python-headless=={version}.*"]
        if subprocess.run(install, check=False).returncode:
            print(f"OpenCV {version} is skipped: pip could not install it")
            return None
    return python


def mrcal_python() -> Path | None:
    python = Path("/usr/bin/python3")
    if (
        python.exists()
        and not subprocess.run([str(python), "-c", "import mrcal"], capture_output=True, check=False).returncode
    ):
        return python
    print("mrcal is skipped: apt-get install python3-mrcal puts it under /usr/bin/python3")
    return None


def ask(python: Path, job: str, scene: Path, repeats: int) -> Row | None:
    """A peer's answer; None with the reason printed when it fails."""
    done = subprocess.run(
        [str(python), str(PEER_SCRIPT), job, str(scene), str(repeats)], capture_output=True, text=True, check=False
    )
    if done.returncode:
        print(f"{job} failed: {done.stderr.strip().splitlines()[-1:]}")
        return None
    answer: Row = json.loads(done.stdout.strip().splitlines()[-1])
    return answer


# What runs in a Python of its own for this project, so that its memory and start are its own too.


def ours(job: str, path: str, repeats: int) -> Row:
    import numba  # noqa: F401
    import scipy.sparse  # noqa: F401

    from calibrant.calibrate.intrinsics.one_model import calibrate_keeping
    from calibrant.data import Observations

    with np.load(path) as file:
        scene = {k: file[k] for k in file.files}
    run: Callable[[], Row]
    if job == "rig":
        from calibrant.calibrate.cell.rig import calibrate_rig

        observations = rig_observations(scene)

        def run() -> Row:
            result = calibrate_rig(observations)
            T = result.transform("camera 0", "camera 1")
            return {"rms_px": result.rms_px, "baseline_m": float(np.linalg.norm(T.matrix[:3, 3]))}
    else:
        size = (int(scene["image_size"][0]), int(scene["image_size"][1]))
        observations = Observations.from_points(list(scene["points"]), list(scene["uv"]), image_size=size)

        def run() -> Row:
            kept = calibrate_keeping(observations)
            if job == "covariance":
                kept.solution.covariances("T_camera_target")
            p = kept.result.camera.parameters
            return {"rms_px": kept.result.rms_px, "fx": p["fx"], "k1": p["k1"]}

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    times: list[float] = []
    found: Row = {}
    for _ in range(repeats + 1):
        start = time.perf_counter()
        found = run()
        times.append(time.perf_counter() - start)
    peak = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    return {"times": times[1:], "first": times[0], "peak_mb": peak, **found}


def ask_ourselves(job: str, scene: Path, repeats: int) -> Row:
    done = subprocess.run(
        [sys.executable, __file__, "--worker", job, str(scene), str(repeats)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    answer: Row = json.loads(done.stdout.strip().splitlines()[-1])
    return answer


def write_scene(folder: Path, views: int) -> Path:
    from calibrant.calibrate.classical import planar as planar_start
    from calibrant.calibrate.reprojection.factor import stack
    from calibrant.geometry import so3
    from calibrant.simulate.scenes import intrinsics_scene

    scene = intrinsics_scene(views)
    stacked = stack(scene.observations.views)
    seen = planar_start.see_plane(stacked)
    centre = (np.array(scene.camera.image_size) - 1) / 2
    focal = planar_start.focal_lengths(seen.H, centre)
    if focal is None:
        raise SystemExit("the scene's views show no focal length")
    T = planar_start.poses(seen.H, np.array([[focal[0], 0, centre[0]], [0, focal[1], centre[1]], [0, 0, 1]]))
    path = folder / f"scene-{views}.npz"
    np.savez(
        path,
        points=np.stack([v.points for v in scene.observations.views]),
        uv=np.stack([v.uv for v in scene.observations.views]),
        image_size=np.array(scene.camera.image_size),
        focal=np.array(focal),
        rt=np.concatenate([so3.log(T[:, :3, :3]), T[:, :3, 3]], axis=1),
    )
    return path


def write_rig(folder: Path, cameras: int = 4, frames: int = 60) -> Path:
    """Four cameras in a row, 0.12 m apart and turned inwards, that all see every board; 0.1 px of noise.

    More than eight stand nearer to each other, about the middle: a longer row sees no board in common.
    """
    from calibrant.geometry import se3, so3
    from calibrant.simulate.scenes import grid, look_at_board, standard_camera

    rng = np.random.default_rng(0)
    camera, points = standard_camera(), grid(11, 8, 0.03)
    step, middle = (0.12, 1.5) if cameras <= 8 else (0.64 / cameras, (cameras - 1) / 2)
    turns = [so3.exp([0, step * (c - middle), 0]) for c in range(cameras)]
    T_camera_rig = np.stack([se3.make(R, -R @ [step * (c - middle), 0, 0]) for c, R in enumerate(turns)])
    kept: list[np.ndarray] = []
    while len(kept) < frames:
        for T in look_at_board(camera, points, 50, rng=rng, distance=(0.7, 1.2), tilt_deg=40):
            uv = np.stack([camera.project(se3.apply(M @ T, points)) for M in T_camera_rig])
            if np.all(np.isfinite(uv)) and np.all(uv > 2) and np.all(uv < np.array(camera.image_size) - 3):
                kept.append(uv + 0.1 * rng.normal(size=uv.shape))
    path = folder / "rig.npz"
    uv = np.stack(kept[:frames], axis=1)
    np.savez(path, points=np.tile(points, (frames, 1, 1)), uv=uv, image_size=np.array(camera.image_size))
    return path


def rig_observations(scene: Row) -> Any:
    from calibrant.data import Observations, View

    size = (int(scene["image_size"][0]), int(scene["image_size"][1]))
    views = tuple(
        View(f"{c}-{f}", p, u, np.arange(len(p)), camera=f"camera {c}", moment=str(f))
        for c, camera in enumerate(scene["uv"])
        for f, (p, u) in enumerate(zip(scene["points"], camera))
    )
    return Observations(views, {f"camera {c}": size for c in range(len(scene["uv"]))})


def median(row: Row | None) -> float:
    return float("nan") if row is None else float(np.median(row["times"]))


def compare(folder: Path, views: list[int], repeats: int, pythons: dict[str, tuple[Path, str]]) -> None:
    head = ["views", "calibrant", "with covariance", *pythons, "fastest / calibrant", "MB", "same optimum"]
    print("\n| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    times: dict[int, float] = {}
    for n in views:
        scene = write_scene(folder, n)
        own = ask_ourselves("intrinsics", scene, repeats)
        full = ask_ourselves("covariance", scene, repeats)
        rows = {name: ask(python, job, scene, repeats) for name, (python, job) in pythons.items()}
        # Once more, so that both sides have run early and late.
        own["times"] += ask_ourselves("intrinsics", scene, repeats)["times"]
        times[n] = median(own)
        fastest = min((median(r) for r in rows.values() if r is not None), default=float("nan"))
        same = all(
            abs(r["fx"] - own["fx"]) < 2e-5 * own["fx"] and abs(r["k1"] - own["k1"]) < 2e-4
            for r in rows.values()
            if r is not None
        )
        cells = [
            f"{median(own):.4f} s",
            f"{median(full) / median(own):.2f}x",
            *(f"{median(r):.3f} s" for r in rows.values()),
        ]
        print(
            f"| {n} | "
            + " | ".join(cells)
            + f" | {fastest / median(own):.1f}x | {own['peak_mb']:.0f} | {'yes' if same else 'NO'} |"
        )
    if 300 in times and 3000 in times:
        print(f"\ngrowth: time(3000) / time(300) = {times[3000] / times[300]:.1f}")


def extended(folder: Path, pythons: dict[str, tuple[Path, str]]) -> None:
    """Standard deviations at 300 views. One run of OpenCV: it takes a minute."""
    scene = write_scene(folder, 300)
    own = ask_ourselves("covariance", scene, 5)
    print(f"\nwith all standard deviations, 300 views: calibrant {median(own):.4f} s")
    for name, (python, job) in pythons.items():
        if job == "opencv":
            row = ask(python, "opencv-extended", scene, 1)
            print(f"  calibrateCameraExtended, {name}: {median(row):.2f} s, {median(row) / median(own):.0f}x")


def rig(folder: Path, pythons: dict[str, tuple[Path, str]]) -> None:
    scene = write_rig(folder)
    own = ask_ourselves("rig", scene, 5)
    error = 1e3 * abs(own["baseline_m"] - 0.12)
    print(f"\nrig, 4 cameras x 60 frames: calibrant {median(own):.4f} s, {own['rms_px']:.4f} px, ", end="")
    print(f"baseline off by {error:.2f} mm")
    if "OpenCV 5.0" in pythons:
        row = ask(pythons["OpenCV 5.0"][0], "multiview", scene, 1)
        if row is not None:
            error = 1e3 * abs(row["baseline_m"] - 0.12)
            print(
                f"  calibrateMultiview, OpenCV 5.0: {median(row):.2f} s, {row['rms_px']:.4f} px, baseline off by "
                f"{error:.2f} mm; {median(row) / median(own):.0f}x"
            )


def first_call(folder: Path) -> None:
    scene = write_scene(folder, 20)
    own = ask_ourselves("intrinsics", scene, 3)
    imports = (
        "import time; t = time.perf_counter(); import numpy, numba, scipy; "
        "import calibrant.calibrate.intrinsics.calibrate; "
    )
    done = subprocess.run(
        [sys.executable, "-c", imports + "print(time.perf_counter() - t)"], capture_output=True, text=True, check=True
    )
    print(f"\nfirst call in a fresh process, warm cache, 20 views: {own['first']:.2f} s; ", end="")
    print(f"imports before: {float(done.stdout):.2f} s")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--views", type=int, nargs="+", default=[20, 100, 300, 1000, 3000])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--skip", nargs="*", default=[], choices=["table", "extended", "rig", "first"])
    parser.add_argument("--worker", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        job, path, repeats = options.worker
        print(json.dumps(ours(job, path, int(repeats))))
        return
    pythons: dict[str, tuple[Path, str]] = {}
    for name, version in OPENCV.items():
        python = opencv_python(version)
        if python is not None:
            pythons[name] = (python, "opencv")
    peer = mrcal_python()
    if peer is not None:
        pythons["mrcal 2.2 (seeded)"] = (peer, "mrcal")
    with tempfile.TemporaryDirectory() as folder:
        where = Path(folder)
        if "table" not in options.skip:
            compare(where, options.views, options.repeats, pythons)
        if "first" not in options.skip:
            first_call(where)
        if "rig" not in options.skip:
            rig(where, pythons)
        if "extended" not in options.skip:
            extended(where, pythons)


if __name__ == "__main__":
    main()
