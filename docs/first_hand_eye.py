"""Makes what docs/first-hand-eye.md shows: the sets of photos, the pictures of them, the table, the commands' output.

    python docs/first_hand_eye.py                       pictures into docs/images, output and table into the page
    python docs/first_hand_eye.py --page                output alone
    python docs/first_hand_eye.py --sets FOLDER         the sets of photos alone, to try the commands on

Everything follows from the seeds below, so that a second run changes nothing.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import textwrap
from dataclasses import replace
from pathlib import Path

import cv2
import matplotlib
import numpy as np
from numpy.typing import NDArray

import calibrant as cb
from calibrant.geometry import se3, so3
from calibrant.simulate import cell as cells
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import gripper_poses, look_at_board, observe, standard_camera

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # the backend has to be chosen first

Array = NDArray[np.float64]
DOCS = Path(__file__).parent
PAGE = DOCS / "first-hand-eye.md"
VIEWS = 12
SETS = {
    "good": "tilted and rolled: good",
    "flat": "turned about one axis: refused",
    "timid": "hardly turned: use with care",
}


def cell_of(name: str) -> cells.Cell:
    """The same cell, photographed well, from straight above, or with a hand that hardly turns."""
    good = cells.make_cell(1, views=VIEWS)
    if name == "good":
        return good
    rng = np.random.default_rng(2)
    if name == "flat":
        R = so3.exp(np.deg2rad(rng.uniform(-80, 80, VIEWS))[:, None] * [0, 0, 1])
    else:
        axis = rng.normal(size=(VIEWS, 3))
        angle = np.deg2rad(rng.uniform(0, 6, VIEWS)) / np.linalg.norm(axis, axis=1)
        R = so3.exp(angle[:, None] * axis) @ so3.exp([0.1, 0.05, 0])
    middle = 0.5 * (good.target.points.min(axis=0) + good.target.points.max(axis=0))
    centre = rng.uniform((-0.07, -0.05, 0.42), (0.07, 0.05, 0.6), (VIEWS, 3))
    B = se3.make(R, centre - R @ middle)
    A = gripper_poses(good.setup, good.X, good.Z, B)
    said = noisy_poses(A, sigma_mm=cells.SIGMA_ROBOT_MM, sigma_deg=cells.SIGMA_ROBOT_DEG, rng=rng)
    poses = cb.RobotPoses.from_matrices(said, ids=good.robot_poses.ids)
    return replace(good, T_base_gripper=A, T_camera_target=B, robot_poses=poses)


def make_sets(folder: Path) -> None:
    """folder/good, folder/flat, folder/timid and folder/swapped: images/NN.png and poses.csv each."""
    for name in SETS:
        cells.photograph(cell_of(name), folder / name)
    lines = (folder / "good" / "poses.csv").read_text(encoding="utf-8").splitlines()
    names, numbers = zip(*(line.split(",", 1) for line in lines[1:]))
    order = list(range(len(names)))
    order[4], order[7] = order[7], order[4]  # as when two lines are pasted in the wrong order
    swapped = [lines[0], *(f"{name},{numbers[k]}" for name, k in zip(names, order))]
    (folder / "swapped.csv").write_text("\n".join(swapped) + "\n", encoding="utf-8")


def contact_sheet(folder: Path, out: Path) -> None:
    """Twelve photos of a set, four in a row."""
    photos = [cv2.imread(str(path)) for path in sorted(folder.glob("*.png"))]
    small = [cv2.resize(photo, (200, 160), interpolation=cv2.INTER_AREA) for photo in photos]
    framed = [cv2.copyMakeBorder(s, 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=(255, 255, 255)) for s in small]
    save(np.vstack([np.hstack(framed[k : k + 4]) for k in range(0, len(framed), 4)]), out)


def save(image: NDArray, out: Path) -> None:
    cv2.imwrite(str(out), image, [cv2.IMWRITE_WEBP_QUALITY, 70])
    if out.stat().st_size >= 100_000:
        raise SystemExit(f"{out.name} has {out.stat().st_size} bytes; pictures of the docs stay below 100 kB")


def draw_cameras(out: Path) -> None:
    """Where the camera stood in each set, seen from the side: board, cameras and what they look along."""
    figure = plt.figure(figsize=(9, 3.2), dpi=90)
    for k, (name, title) in enumerate(SETS.items()):
        cell = cell_of(name)
        axes = figure.add_subplot(1, 3, k + 1, projection="3d", computed_zorder=False)
        T = cell.Z @ se3.inverse(cell.T_camera_target)  # T_base_camera
        x0, y0, x1, y1 = cell.target.artwork().bounds
        sheet = [[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0], [x0, y0, 0]]
        board = se3.apply(cell.Z, np.array(sheet))
        axes.plot(*board.T, color="black", linewidth=1.5)
        corners = 0.08 * np.array([[-0.6, -0.5, 1], [0.6, -0.5, 1], [0.6, 0.5, 1], [-0.6, 0.5, 1]])
        for pose in T:
            rim = se3.apply(pose, corners)
            axes.plot(*np.vstack([rim, rim[:1]]).T, color="tab:blue", linewidth=0.8)
            for corner in rim:
                axes.plot(*np.vstack([pose[:3, 3], corner]).T, color="tab:blue", linewidth=0.8)
            axes.plot(*np.vstack([pose[:3, 3], se3.apply(pose, [0, 0, 0.2])]).T, color="tab:red", linewidth=0.6)
        middle = board.mean(axis=0)
        axes.set(
            xlim=(middle[0] - 0.4, middle[0] + 0.4), ylim=(middle[1] - 0.4, middle[1] + 0.4), zlim=(0, 0.65),
            title=title,
        )  # fmt: skip
        axes.set_box_aspect((0.8, 0.8, 0.65), zoom=1.25)
        axes.set_axis_off()
        axes.view_init(elev=12, azim=-60)
    figure.subplots_adjust(left=0, right=1, bottom=0, top=0.92, wspace=0)
    figure.canvas.draw()
    save(cv2.cvtColor(np.asarray(figure.canvas.buffer_rgba()), cv2.COLOR_RGBA2BGR), out)
    plt.close(figure)


def draw_photos(out: Path) -> None:
    """One good photo and three that help little, with what the detector says of each."""
    target, camera, rng = cb.parse_target(cells.TARGET), standard_camera(), np.random.default_rng(0)
    middle = 0.5 * (target.points.min(axis=0) + target.points.max(axis=0))

    def at(tilt_deg: float, distance: float) -> Array:
        R = so3.exp(np.deg2rad(tilt_deg) * np.array([0.0, 1.0, 0.0])) @ so3.exp([0, 0, 0.2])
        return se3.make(R, np.array([0, 0, distance]) - R @ middle)

    kinds = {
        "sharp, large, tilted by 25 deg": (at(25, 0.4), Look()),
        "blurred by motion or focus": (at(25, 0.4), Look(blur_px=6.0)),
        "far away": (at(25, 1.8), Look()),
        "tilted by 78 deg": (at(78, 0.4), Look()),
    }
    tiles = []
    for title, (T, look) in kinds.items():
        image = render(target.artwork(), camera, T, rng=rng, look=look)
        with tempfile.TemporaryDirectory() as folder:
            cv2.imwrite(f"{folder}/0.png", image)
            views = cb.detect([f"{folder}/0.png"], target=target).views
        said = "not found"
        if views:
            truth = camera.project(se3.apply(T, views[0].points))
            off = np.sqrt(np.mean((views[0].uv - truth) ** 2))
            said = f"{len(views[0])} of {len(target.points)} corners, off by {off:.2g} px rms"
        tile = cv2.cvtColor(cv2.resize(image, (400, 320), interpolation=cv2.INTER_AREA), cv2.COLOR_GRAY2BGR)
        tile = cv2.copyMakeBorder(tile, 44, 4, 2, 2, cv2.BORDER_CONSTANT, value=(255, 255, 255))
        for row, text in enumerate((title, said)):
            cv2.putText(tile, text, (4, 16 + 20 * row), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
        tiles.append(tile)
    save(np.vstack([np.hstack(tiles[:2]), np.hstack(tiles[2:])]), out)


def accuracy_table(seeds: int = 12) -> str:
    """Rows of the page's table: the camera's error in mm (median of simulated cells) by photos and largest turn."""
    counts, angles = (5, 8, 12, 20), (5, 15, 30, 45)
    rows = [f"| photos | {' | '.join(f'up to {a}°' for a in angles)} |", "|---" * (len(angles) + 1) + "|"]
    for count in counts:
        cols = [
            f"{np.median([camera_error_mm(count, angle, seed) for seed in range(seeds)]):.2g} mm" for angle in angles
        ]
        rows.append(f"| {count} | {' | '.join(cols)} |")
    return "\n".join(rows)


def camera_error_mm(count: int, angle_deg: float, seed: int) -> float:
    """How far off the camera is: a good arm, a known camera, a board tilted and rolled by up to an angle."""
    cell, rng = cells.make_cell(seed, views=3), np.random.default_rng([seed, count])
    points, camera = cell.target.points, standard_camera()
    B = look_at_board(
        camera, points, count, rng=rng, distance=cells.WORKING_DISTANCE, tilt_deg=angle_deg, roll_deg=angle_deg
    )
    said = noisy_poses(
        gripper_poses(cell.setup, cell.X, cell.Z, B),
        sigma_mm=cells.SIGMA_ROBOT_MM, sigma_deg=cells.SIGMA_ROBOT_DEG, rng=rng,
    )  # fmt: skip
    seen = observe(camera, points, B, sigma_px=0.05, rng=rng)
    result = cb.calibrate_hand_eye(cb.RobotPoses.from_matrices(said), seen, setup=cell.setup, camera=camera)
    return float(1e3 * np.linalg.norm(result.transform("gripper", "camera").matrix[:3, 3] - cell.X[:3, 3]))


BLOCK = re.compile(
    r"(?P<mark><!-- (?P<what>table|truth|out)(?: (?P<first>[^\n>]+?) \.\.\. ?(?P<last>[^\n>]*?))? -->)"
    r"(?P<old>\n```text\n.*?\n```|\n\|.*?(?=\n\n)|\nThe truth.*?(?=\n\n))?",
    re.S,
)
COMMAND = re.compile(r"```bash\n(?P<lines>(?:calibrant [^\n]*\n(?: [^\n]*\n)*)+)```")


def refreshed(page: str, folder: Path, table: str | None) -> str:
    """The page with its table, and behind every command what the command prints.

    `<!-- out FIRST ... LAST -->` stands before a text block: from the line that starts with FIRST to the one before
    LAST (to the next empty line without it) of what the command above it printed.
    """
    out, at, said = [], 0, ""
    for match in re.finditer(f"{COMMAND.pattern}|{BLOCK.pattern}", page, re.S):
        out.append(page[at : match.start()])
        at = match.end()
        if match["lines"]:
            said = "".join(run(line, folder) for line in re.sub(r"\\\n *", "", match["lines"]).splitlines())
            out.append(match[0])
        elif match["what"] == "out":
            out.append(match["mark"] + "\n```text\n" + excerpt(said, match["first"], match["last"]) + "\n```")
        elif match["what"] == "table" and table is None:
            out.append(match[0])
        else:
            out.append(match["mark"] + "\n" + (table if match["what"] == "table" else truth()))
    return "".join(out) + page[at:]


def truth() -> str:
    """The good set's T_gripper_camera, as only a simulation knows it."""
    x, y, z = 1e3 * cell_of("good").X[:3, 3]
    return f"The truth of this simulation is x = {x:.3f}, y = {y:.3f}, z = {z:.2f} mm."


def run(line: str, folder: Path) -> str:
    """What a command prints, without its progress; its exit status behind it where that is not 0."""
    command = f"{sys.executable} -m {line}"
    done = subprocess.run(
        command, shell=True, cwd=folder, text=True, capture_output=True, env=environment(), check=False
    )
    told = [line for line in done.stderr.splitlines() if line.startswith("calibrant:")]
    errors = "".join(textwrap.fill(line, 100, break_on_hyphens=False) + "\n" for line in told)
    status = f"(exit status {done.returncode})\n" if done.returncode else ""
    return "\n".join(text.rstrip() for text in (done.stdout + errors + status).splitlines()) + "\n"


def environment() -> dict[str, str]:
    return os.environ | {"COLUMNS": "100", "NO_COLOR": "1", "PYTHONPATH": str(DOCS.parent / "src")}


def excerpt(said: str, first: str | None, last: str | None) -> str:
    """Lines of an output, see `refreshed`."""
    if not first or first == "all":
        return said.strip("\n")
    lines = said.splitlines()
    start = next((k for k, line in enumerate(lines) if line.startswith(first)), None)
    if start is None:
        raise SystemExit(f"no line starts with {first!r} in:\n{said}")
    below = range(start + 1, len(lines))
    empty = next((k for k in below if not lines[k].strip()), None)
    end = next((k for k in below if last and lines[k].startswith(last)), empty)
    return "\n".join(lines[start:end]).rstrip()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=Path, help="make the sets of photos in this folder, and nothing else")
    parser.add_argument("--page", action="store_true", help="run the page's commands again; pictures and table stay")
    given = parser.parse_args()
    if given.sets:
        make_sets(given.sets)
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_sets(folder)
        if not given.page:
            draw(folder)
        table = None if given.page else accuracy_table()
        PAGE.write_text(refreshed(PAGE.read_text(encoding="utf-8"), folder, table), encoding="utf-8")


def draw(folder: Path) -> None:
    """The page's pictures, of the sets in a folder."""
    for kind in SETS:
        contact_sheet(folder / kind / "images", DOCS / "images" / f"first-{kind}.webp")
    draw_cameras(DOCS / "images" / "first-cameras.webp")
    draw_photos(DOCS / "images" / "first-photos.webp")


if __name__ == "__main__":
    main()
