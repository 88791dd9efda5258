"""The whole chain on a simulated robot cell: photographed, calibrated as a user would, and compared with its truth.

The pictures and poses go into the demo's own folder, since they are read from there; its results are documents.
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

from calibrant.errors import InputError, RefusedError
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.outcome import Answer, Outcome, page_document, result_document

if TYPE_CHECKING:
    from rich.console import RenderableType

    from calibrant.data import CalibrationResult
    from calibrant.simulate.cell import Cell
    from calibrant.simulate.scenes import Setup
    from calibrant.tasks.demo.comparison import Compared

EXAMPLE = 'cb.demo(seed=1, out="calibrant-demo")'

MARK = "truth.json"
"""The file by which a demo knows a folder that it wrote itself, and may therefore write again."""
RESULTS = ("camera.json", "hand-eye.json", "report.html")


@dataclass(frozen=True, kw_only=True)
class Request:
    """Calibrate a simulated robot cell, with no hardware and no files.

    calibrant demo [--seed N] [--out DIR] [--views N] [--setup eye-in-hand|eye-to-hand]

    A camera on a simulated UR5e photographs a ChArUco board; pictures and robot poses go to DIR. Then everything runs
    as on your own data: find the board, calibrate the camera, calibrate hand and eye, write results and report. At the
    end each figure stands beside its predicted uncertainty and beside the truth, which only a simulation knows.
    """

    seed: Annotated[int, Option("N")] = 0
    """Which cell to simulate: mounting, views, noise."""
    out: Annotated[Path, Option("DIR")] = Path("calibrant-demo")
    """Folder to write; one that an earlier demo wrote is replaced."""
    views: Annotated[int, Option("N")] = 20
    """How many pictures the robot takes, 5 to 200."""
    setup: Annotated[str, Option("eye-in-hand|eye-to-hand")] = "eye-in-hand"
    """Camera on the gripper, or beside the robot."""


@dataclass(frozen=True, eq=False)
class Demo:
    """What came out: both results, the comparison with the truth, the inputs' places, the time each step took."""

    intrinsics: CalibrationResult
    compared: Compared
    images: Path
    poses: Path
    seconds: dict[str, float]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The hand-eye result of the cell, its files and its comparison with the truth.

    Raises: InputError when the folder holds something that no demo wrote, or cannot be written; RefusedError when the
    calibration refuses its data.
    """
    from calibrant.data.result_encoding import format_json

    setup = _checked(request)
    done = run_demo(request.out, seed=request.seed, views=request.views, setup=setup, listener=listener)
    found = done.compared.hand_eye
    return Outcome(
        answer=Answer(found, lambda: format_json(result_json(done))),
        documents=(
            result_document(done.intrinsics, request.out / RESULTS[0]),
            result_document(found, request.out / RESULTS[1]),
            page_document(found, request.out / RESULTS[2]),
        ),
        summary=partial(_said, done, request.out),
    )


def _checked(request: Request) -> Setup:
    """The setup. Raises: InputError for an option out of range."""
    from calibrant.simulate.scenes import Setup

    if request.seed < 0:
        raise InputError(f"--seed {request.seed}: take 0 or more")
    if not 5 <= request.views <= 200:
        raise InputError(f"--views {request.views}: the robot takes 5 to 200 pictures")
    for setup in get_args(Setup):
        if setup == request.setup:
            return setup
    raise InputError(f"--setup is {' or '.join(get_args(Setup))}, got {request.setup!r}")


def run_demo(folder: Path, *, seed: int, views: int, setup: Setup, listener: Listener = SILENT) -> Demo:
    """Photograph a cell into `folder` and calibrate it from these files alone, as `calibrant hand-eye` does.

    Raises: as `run`.
    """
    from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
    from calibrant.data.result_file import write_text
    from calibrant.simulate.cell import make_cell, photograph
    from calibrant.tasks.demo.comparison import compared
    from calibrant.tasks.robots import hand_eye as task

    cell = make_cell(seed, setup=setup, views=views)
    _claim(folder)
    clock = _Clock()
    write_text(_truth_text(cell), folder / MARK, force=True)
    with listener.progress("Photographing the board") as step:
        images, poses = photograph(cell, folder, progress=lambda done, total: step(done, total, ""))
    clock.lap("photograph")
    request = task.Request(
        poses=(str(poses),), images=(str(images[0].parent),), target=(cell.target.spec,), setup=(setup,)
    )
    found = task.run(request, listener).result
    clock.lap("detect and calibrate")
    if found is None or found.observations is None or len(found.transforms) != 2:
        raise RefusedError(
            "the calibration of the simulated cell gave no transforms; run again with --debug, report it"
        )
    with listener.status("Calibrating the camera by itself …"):
        intrinsics = calibrate_intrinsics(found.observations)
    clock.lap("camera")
    return Demo(intrinsics, compared(cell, found), images[0].parent, poses, clock.laps)


class _Clock:
    """Time between laps, by name."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name] = now - self._last
        self._last = now


def _claim(folder: Path) -> None:
    """Make the folder, or clear the pictures of the demo that wrote it; anything else is not ours to touch."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; the demo writes a folder: choose another one with --out")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / MARK).is_file():
        raise InputError(
            f"{folder} is not empty and no demo wrote it, so it is left as it is; choose another folder with --out"
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # An earlier demo's results are not this one's, and with more views it would leave pictures without a pose.
        for old in (*(folder / "images").glob("[0-9]*.png"), *(folder / name for name in RESULTS)):
            old.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"cannot write to {folder}: {error.strerror}; choose another folder with --out") from error


def _truth_text(cell: Cell) -> str:
    from calibrant.tasks.demo.comparison import truth_names

    X_name, Z_name = truth_names(cell.setup)
    truth = {
        "seed": cell.seed,
        "setup": cell.setup,
        "target": cell.target.spec,
        "camera": cell.camera.parameters,
        X_name: cell.X.tolist(),
        Z_name: cell.Z.tolist(),
    }
    return json.dumps(truth, indent=1) + "\n"


def result_json(outcome: Demo) -> dict[str, Any]:
    """The hand-eye result in the format of result files, with the comparison under `truth`."""
    from calibrant.data.result_encoding import encode

    at = outcome.compared
    camera, point = at.camera_truth, at.tool_point
    truth = {
        "matrix": at.cell.X.tolist(),
        "error_translation_mm": camera.translation_mm,
        "error_rotation_deg": camera.rotation_deg,
        "normalised_error": camera.normalised,
        "limit": camera.limit,
        "inside": camera.inside,
        "tool_point_error_mm": point.error_mm,
        "tool_point_sigma_mm": point.sigma_mm,
        "camera": at.cell.camera.parameters,
        "seconds": outcome.seconds,
    }
    return {**encode(at.hand_eye), "truth": truth}


def _said(done: Demo, folder: Path) -> tuple[CalibrationResult, RenderableType]:
    """Summary of the result, the comparison, the inputs' places, and the command that repeats the calibration."""
    from rich.console import Group
    from rich.text import Text

    from calibrant.tasks.demo.comparison import comparison

    cell = done.compared.cell
    # An option a line: a whole command line is wider than a terminal, which would cut it.
    options = {"images": done.images, "poses": done.poses, "target": cell.target.spec, "setup": cell.setup}
    command = "calibrant hand-eye " + " \\\n      ".join(f"--{name} {value}" for name, value in options.items())
    repeat = Text(f"\nThe same from the files alone:\n  {command}", overflow="fold")
    return done.compared.hand_eye, Group(
        Text(),
        comparison(done.compared),
        Text(f"images       {done.images}\nrobot poses  {done.poses}"),
        repeat,
        Text(f"Took {sum(done.seconds.values()):.0f} s."),
    )
