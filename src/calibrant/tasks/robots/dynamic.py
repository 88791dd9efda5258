"""Locate a camera beside the robot: read the wrist's calibration and the photos, take the views in one by one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.cancel import checkpoint
from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.poses import PoseOptions
from calibrant.tasks.options.robots import RobotOptions
from calibrant.tasks.options.words import pixels
from calibrant.tasks.outcome import Outcome

if TYPE_CHECKING:
    import numpy as np

    from calibrant.calibrate.dynamic.problem import WristCamera
    from calibrant.calibrate.dynamic.track import DynamicCalibration, DynamicNoise
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult, Observations, View
    from calibrant.formats.poses.read import PoseNotation

EXAMPLE = (
    'cb.dynamic(wrist="hand-eye.json", camera="front.json", wrist_images="wrist", external_images="front", '
    'poses="poses.csv", target="chessboard:9x6:25mm")'
)
PLACEMENTS = ("still", "moves")
LEAST_SPARE = 30
"""Numbers that tell a noise level to 13 %."""
COARSE_PX = 1.0
"""Corners are found to some tenths of a pixel where the lens is known: beyond a pixel the lens is another."""
NO_FIT = 10.0
"""Times their noise that the residuals may be: what is off by more are photos of another camera, pose or place."""
DO_NOT_FIT = (
    f"the photos do not fit together: whatever way the poses are read, they are more than {NO_FIT:.0f} times their "
    "noise apart; check that each option has the photos of its own camera, that the poses are those of the wrist's "
    "photos, and that the target did not move (--target-stands moves)"
)


@dataclass(frozen=True, kw_only=True)
class Request:
    """Locate a camera beside the robot through the wrist camera and a target that both see.

    calibrant dynamic --wrist hand-eye.json --camera front.json --wrist-images wrist/*.png \\
        --external-images front/*.png --poses poses.csv --target charuco:5x7:36mm:18mm:DICT_6X6_250

    calibrant dynamic --live --wanted place.json --wrist hand-eye.json --camera front.json --wrist-images wrist/*.png \\
        --poses poses.csv --external-images 0 --target charuco:5x7:36mm:18mm:DICT_6X6_250
    calibrant dynamic --live --cell --seed 3

    Says how certain the place is, and which source it owes that to: the wrist's calibration, either camera's pixels,
    the external intrinsics, or the robot.
    """

    wrist: Annotated[Path | None, Option("FILE")] = None
    """The wrist camera's hand-eye result."""
    camera: Annotated[Path | None, Option("FILE")] = None
    """The external camera (any format)."""
    wrist_images: Annotated[tuple[str, ...], Option("IMAGES")] = ()
    """Photos by the wrist camera."""
    external_images: Annotated[tuple[str, ...], Option("IMAGES")] = ()
    """Photos by the external one; with --live the running camera: its number, or a video or folder that plays it."""
    poses: Annotated[tuple[str, ...], Option("FILES")] = ()
    """Robot poses of the wrist's photos."""
    target: Annotated[str | None, Option("SPEC", "-t")] = None
    """The board: chessboard:9x6:25mm (inner corners), charuco:5x7:36mm:18mm:DICT_6X6_250 (squares), or a file."""
    target_stands: Annotated[str, Option("HOW")] = "still"
    """still: in one place for all photos; moves: the n-th photos of both show its n-th place."""
    sigma_px: Annotated[str | None, Option("LENGTH")] = None
    """Noise of the external camera's corners; what its own views leave unless given."""
    live: bool = False
    """Say place and sigma after every picture of the running external camera, while it is moved; Ctrl-C ends it."""
    wanted: Annotated[Path | None, Option("FILE")] = None
    """With --live: a result with base -> external, the place that the camera is led to, in words."""
    pictures: Annotated[int, Option("N")] = 0
    """With --live: end after this many pictures; 0: go on until Ctrl-C, or the end of the video."""
    cell: bool = False
    """With --live: a simulated cell, whose front camera is located and then led to another place."""
    seed: Annotated[int, Option("N")] = 0
    """Which simulated cell."""
    arm: RobotOptions = RobotOptions()
    form: PoseOptions = PoseOptions()


@dataclass(frozen=True, eq=False)
class Taken:
    """The estimate after all views, and the ids of the views that surprised it."""

    known: DynamicCalibration
    surprises: tuple[str, ...]

    @property
    def off(self) -> float:
        """The residuals' root mean square over their noise."""
        solution = self.known.solution
        numbers = sum(2 * len(sight.view) for sight in self.known.sights)
        return float("inf") if solution is None else sqrt(2 * solution.cost / max(numbers, 1))


def reads(request: Request) -> list[str | Path]:
    """Both cameras' files, the photos, the poses, and the robot's file."""
    from calibrant.detection.images.files import expand

    if request.cell:
        return []
    photos = expand([*request.wrist_images, *(() if request.live else request.external_images)])
    named = [f for f in (request.wrist, request.camera, request.wanted) if f is not None]
    return [*named, *request.poses, *photos, *request.arm.files]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The external camera in the base. Raises: InputError; RefusedError where the photos do not fit together."""
    from calibrant.data.verdicts import refuse_if_failed
    from calibrant.formats.cameras.read import read_camera
    from calibrant.formats.poses.pairing import match_raw
    from calibrant.tasks.inputs.pose_choice import best_reading

    if request.target_stands not in PLACEMENTS:
        raise InputError(f"--target-stands {request.target_stands}: choose {' or '.join(PLACEMENTS)}")
    if request.live:
        from calibrant.tasks.robots.dynamic_live import live

        return live(request, listener)
    if request.cell or request.wanted is not None or request.pictures:
        raise InputError("--cell, --wanted and --pictures go with --live")
    wrist, noise = wrist_of(needed(request).wrist)
    raw = request.form.read(request.poses, request.arm)
    near = boards(request, request.wrist_images, "wrist", listener)
    far = boards(request, request.external_images, "external", listener)
    if request.target_stands == "moves" and len(near.views) != len(far.views):
        raise InputError(
            f"{len(near.views)} photos of the wrist camera and {len(far.views)} of the external one show the board; "
            "where the target moves, the n-th photos of both belong together: leave out those without a partner"
        )
    external = read_camera(needed(request).camera, image_size=next(iter(far.image_sizes.values())))
    pairing = match_raw(raw, [v.id for v in near.views])
    session.load_solver(listener)
    given = pixels(request.sigma_px, option="--sigma-px")
    noise = replace(noise, external_px=given or own_noise(external, far.views) or noise.external_px)

    def attempt(reading: PoseNotation) -> Taken:
        T = reading.T_base_gripper[list(pairing.pose_index)]
        views = [near.views[i] for i in pairing.view_index]
        return take_in(wrist, external, noise, views, T, far.views, moves=request.target_stands == "moves")

    with listener.status("Taking in the views …"):
        chosen = best_reading(
            raw, attempt, lambda t: t.known.solution.cost if t.known.solution else float("inf"),
            fits=lambda t: t.off < NO_FIT, what=DO_NOT_FIT,
        )  # fmt: skip
    result = dynamic_result(chosen.outcome, request, chosen.reading.description, pairing.message, noise)
    refuse_if_failed(result)
    return Outcome(result=result)


@dataclass(frozen=True)
class Needed:
    """What photos cannot be taken in without."""

    wrist: Path
    camera: Path
    target: str


def needed(request: Request) -> Needed:
    """Raises: InputError naming the first option that is missing."""
    given = {
        "--wrist": request.wrist, "--camera": request.camera, "--wrist-images": request.wrist_images,
        "--external-images": request.external_images, "--poses": request.poses,
    }  # fmt: skip
    missing = [option for option, value in given.items() if not value]
    if missing:
        raise InputError(f"the external camera is located by {', '.join(given)}; missing: {', '.join(missing)}")
    if request.target is None:
        raise InputError("photos need the board they show: --target, such as chessboard:9x6:25mm")
    if request.wrist is None or request.camera is None:
        raise InputError("--wrist and --camera name the two cameras' files")
    return Needed(request.wrist, request.camera, request.target)


def own_noise(camera: Camera, views: Sequence[View]) -> float | None:
    """Pixels per axis that the views of a camera leave, each at its own pose; None where they are too few points.

    Another lens, another distance and another light than the wrist camera's: its noise says nothing of this one's.
    """
    import numpy as np

    from calibrant.calibrate.pose.target_poses import target_poses

    spare = sum(2 * len(v) - 6 for v in views)
    if spare < LEAST_SPARE:
        return None
    found = target_poses(camera, views)
    counts = np.array([len(v) for v in views])
    return float(np.sqrt(np.sum(counts * found.rms_px**2) / spare))


def wrist_of(path: Path) -> tuple[WristCamera, DynamicNoise]:
    """From a file: `wrist_from`."""
    from calibrant.data.result_file import read_result

    return wrist_from(read_result(path), str(path))


def wrist_from(known: CalibrationResult, name: str) -> tuple[WristCamera, DynamicNoise]:
    """The wrist camera with its joint covariance, and the noise, from a hand-eye result.

    Raises: InputError for a result that is not of a camera on the gripper, or was not made from images.
    """
    import numpy as np

    from calibrant.calibrate.dynamic.problem import WristCamera
    from calibrant.calibrate.dynamic.track import DynamicNoise
    from calibrant.diagnose.budget.cell import error_budget

    budget = error_budget(known)
    if budget.setup.camera_parent != "gripper" or budget.camera is None or budget.noise is None:
        raise InputError(f"{name}: expected the hand-eye result of a camera on the gripper, made from images")
    rows = np.r_[0:6, 12 : 12 + len(budget.camera.values)]
    covariance = budget.covariance[np.ix_(rows, rows)]
    n = budget.noise
    noise = DynamicNoise(n.pixel, n.pixel, n.robot_rotation, n.robot_translation)
    return WristCamera(budget.camera, budget.X, covariance), noise


def take_in(
    wrist: WristCamera,
    external: Camera,
    noise: DynamicNoise,
    near: Sequence[View],
    T_base_gripper: np.ndarray,
    far: Sequence[View],
    *,
    moves: bool,
) -> Taken:
    """All views, one by one: in pairs where the target moves, else the wrist camera's first."""
    from calibrant.calibrate.dynamic.track import DynamicCalibration

    known, surprises = DynamicCalibration(wrist, external, noise), []

    def noted(after: DynamicCalibration) -> DynamicCalibration:
        if after.last is not None and after.last.surprising:
            surprises.append(after.last.view)
        return after

    for i, (view, T) in enumerate(zip(near, T_base_gripper)):
        checkpoint()
        known = noted((known.target_moved() if moves else known).seen_by_wrist(view, T))
        if moves:
            known = noted(known.seen_by_external(far[i]))
    for view in () if moves else far:
        checkpoint()
        known = noted(known.seen_by_external(view))
    return Taken(known, tuple(surprises))


def boards(request: Request, images: Sequence[str], camera: str, listener: Listener) -> Observations:
    from calibrant.detection.images.files import expand

    files = expand(list(images))
    found = session.detect_boards(
        files, request.target or "", mirror_x=False, workers=None, camera=camera, listener=listener
    )
    if not found.views:
        raise InputError(f"no photo of the {camera} camera shows the board; the first: {found.missed[0].reason}")
    return found


def dynamic_result(
    taken: Taken, request: Request, reading: str, pairing: str, noise: DynamicNoise
) -> CalibrationResult:
    import numpy as np

    from calibrant.data import CalibrationResult, Check, Measured, verdict_of
    from calibrant.data.verdicts import stamp
    from calibrant.diagnose.budget.workspace import budget_words, sigma_mm

    known, estimate = taken.known, taken.known.T_base_external
    covariance = np.asarray(estimate.covariance)
    text = (
        f"the external camera is known to {float(sigma_mm(covariance[3:, 3:])):.3g} mm and "
        f"{float(np.rad2deg(1e-3 * sigma_mm(covariance[:3, :3]))):.2g} deg (1 sigma, worst direction). "
        f"{budget_words(known.shares)}"
    )
    checks = [Check("certainty", "ok", text, float(sigma_mm(covariance[3:, 3:])))]
    if taken.surprises:
        words = f"{', '.join(taken.surprises)}: at odds with the views before; did the target or a camera move?"
        checks.append(Check("consistency", "warn", words, float(len(taken.surprises))))
    else:
        checks.append(Check("consistency", "ok", f"{len(known.sights)} views agree within their noise", 0.0))
    levels = f"noise of a corner: {noise.wrist_px:.2g} px (wrist), {noise.external_px:.2g} px (external)"
    coarse = noise.external_px > COARSE_PX
    levels += "; is the external camera's file that of the camera that took them?" if coarse else ""
    checks.append(Check("noise", "warn" if coarse else "ok", levels, noise.external_px))
    checks += [Check("pose-reading", "ok", reading), Check("pairing", "ok", pairing)]
    shares = {f"variance by {source}": Measured(round(share, 4)) for source, share in known.shares.items()}
    return stamp(
        CalibrationResult(
            "dynamic", verdict_of(tuple(checks)), tuple(checks), cameras={"external": known.camera},
            transforms=(estimate,), figures=shares,
            decided={"pose_reading": reading}, inputs=session.file_records(reads(request)),
            options={"target": request.target, "target_stands": request.target_stands},
        )
    )  # fmt: skip
