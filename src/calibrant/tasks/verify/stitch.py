"""Depth pictures of many poses, put together by the calibration: do their surfaces agree?"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.cell import CellOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.poses import PoseOptions
from calibrant.tasks.options.robots import RobotOptions
from calibrant.tasks.options.words import pixels
from calibrant.tasks.outcome import Outcome
from calibrant.tasks.verify.placings import as_calibrated
from calibrant.tasks.verify.sides import Compare
from calibrant.tasks.verify.touch import refusal_of

if TYPE_CHECKING:
    from calibrant.arrays import Array
    from calibrant.cameras import Camera
    from calibrant.perceive.registered_depth.noise import DepthNoise
    from calibrant.verification.stitch.clouds import Pair

EXAMPLE = 'cb.verify_stitch("hand-eye.json", depth="depth/*.png", poses="poses.csv", tolerance="2mm")'


@dataclass(frozen=True, kw_only=True)
class Request:
    """Put depth pictures of many poses together by the calibration: how far their surfaces are apart, pass or fail.

    calibrant verify stitch hand-eye.json --depth depth/*.png --poses poses.csv --tolerance 2mm
    calibrant verify stitch --cell --seeds 5

    For a depth camera in the robot's hand. Every picture is compared with every other one, along the normals of what
    both show; beside it stands the distance that calibration, robot and depth noise predict.
    """

    result: Annotated[Path | None, Option("RESULT.json", positional=True)] = None
    """The calibration: a result of hand-eye; not with --cell."""
    depth: Annotated[tuple[str, ...], Option("FILES")] = ()
    """Depth pictures: 16-bit PNG in millimetres, or .npy in metres."""
    poses: Annotated[tuple[str, ...], Option("FILES")] = ()
    """Robot poses of the pictures, in their order: a file, or one file a pose."""
    depth_camera: Annotated[Path | None, Option("FILE")] = None
    """The depth camera (any format), where depth is not of the calibrated camera's own grid."""
    depth_at: Annotated[str | None, Option("PLACE")] = None
    """Where it is in the calibrated camera: x,y,z,roll,pitch,yaw with units, such as 15mm,0mm,0mm,0deg,0deg,0deg."""
    baseline: Annotated[str, Option("LENGTH")] = "50mm"
    """Of the depth camera: D435 50mm, D455 95mm."""
    sigma_disparity: Annotated[str, Option("PX")] = "0.08px"
    """Noise of its disparities."""
    sigma_scale: Annotated[float, Option("PERCENT")] = 0.1
    """1 sigma of a factor that all depths share, per cent."""
    name: Annotated[str | None, Option("CAMERA")] = None
    """Which camera of the result it is, where there are several."""
    tolerance: Annotated[str | None, Option("LENGTH")] = None
    """Largest distance of a pair, rms, that passes: 2mm."""
    cells: CellOptions = CellOptions()
    form: PoseOptions = PoseOptions()
    arm: RobotOptions = RobotOptions()


def reads(request: Request) -> list[str | Path]:
    """The result, the depth, the poses, the depth camera."""
    if request.cells.cell or request.result is None:
        return []
    camera = [] if request.depth_camera is None else [request.depth_camera]
    return [request.result, *_files(request), *request.poses, *camera, *request.arm.files]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """Whether the clouds agree, as a result of kind "stitch". Raises: InputError."""
    from calibrant.targets.lengths import parse_length
    from calibrant.verification.runs import runs_text
    from calibrant.verification.stitch.result import stitch_result

    tolerance = None if request.tolerance is None else 1e3 * parse_length(request.tolerance, what="--tolerance")
    request.cells.check()
    if request.cells.cell:
        from calibrant.tasks.verify.in_cell.stitch import stitch_series

        if request.result is not None or request.depth:
            raise InputError("--cell calibrates and looks by itself: leave the result and the depth out")
        found = stitch_series(request.cells, tolerance_mm=tolerance, listener=listener)
        return Outcome(result=found, printed=partial(runs_text, found), refusal=refusal_of(found, "stitch"))
    with listener.status("Putting clouds together …"):
        pairs = _pairs(request)
        result = stitch_result(pairs, tolerance_mm=tolerance)
    options = {"result": str(request.result), "tolerance": request.tolerance, "baseline": request.baseline}
    result = replace(result, options=options, inputs=session.file_records(reads(request)))
    return Outcome(result=result, refusal=refusal_of(result, "stitch"))


def _files(request: Request) -> list[Path]:
    from calibrant.detection.images.files import expand

    if not request.depth:
        raise InputError("no depth pictures were given: name those of two poses or more with --depth")
    return expand(list(request.depth))


def _pairs(request: Request) -> tuple[Pair, ...]:
    import numpy as np

    from calibrant.data.result_file import read_result
    from calibrant.detection.images.depth_files import read_depth
    from calibrant.perceive.registered_depth.planes import rays_of
    from calibrant.verification.stitch.clouds import all_pairs, cloud_of
    from calibrant.verification.unchanged.robot_noise import robot_side

    if request.result is None:
        raise InputError("give the calibration to verify (a result of `calibrant hand-eye`), or --cell")
    compare = Compare.of(read_result(request.result), request.name, None)
    if not compare.on_robot:
        raise InputError(f"{request.result} is of kind {compare.kind!r}: clouds are put together by a hand-eye result")
    side = robot_side(compare.known, compare.name)
    if not side.in_hand or not request.poses:
        raise InputError(
            "clouds of many poses need a depth camera in the robot's hand, and the robot's poses (--poses FILE)"
        )
    files, camera, T_camera_depth = _files(request), *_depth_camera(request, compare)
    raw = request.form.read(request.poses, request.arm)
    if len(raw) != len(files):
        raise InputError(f"{len(files)} depth pictures and {len(raw)} poses: one pose a picture, in the same order")
    T = as_calibrated(compare, raw, list(range(len(raw))), [f.name for f in files])
    rays = rays_of(camera)
    clouds = []
    for file, A in zip(files, T):
        depth = read_depth(file)
        if depth.shape != rays.shape[:2]:
            raise InputError(
                f"{file} is {depth.shape[1]}x{depth.shape[0]} px, its camera "
                f"{camera.image_size[0]}x{camera.image_size[1]}: "
                "give the depth camera (--depth-camera FILE) and its place (--depth-at)"
            )
        clouds.append(cloud_of(file.name, depth, rays, A @ side.X @ T_camera_depth, A))
    p = camera.parameters
    K = np.array([[p["fx"], 0, p["cx"]], [0, p["fy"], p["cy"]], [0, 0, 1.0]])
    return all_pairs(clouds, K, side, _noise(request, camera))


def _depth_camera(request: Request, compare: Compare) -> tuple[Camera, Array]:
    """The depth camera and T_camera_depth."""
    import numpy as np

    from calibrant.formats.cameras.read import read_camera
    from calibrant.tasks.inputs.placement import parse_placement

    place = np.eye(4) if request.depth_at is None else parse_placement(request.depth_at, what="--depth-at")
    if request.depth_camera is None:
        return compare.camera, place
    return read_camera(request.depth_camera), place


def _noise(request: Request, camera: Camera) -> DepthNoise:
    from calibrant.perceive.registered_depth.noise import DepthNoise
    from calibrant.targets.lengths import parse_length

    return DepthNoise.stereo(
        focal_px=float(camera.parameters["fx"]),
        baseline_m=parse_length(request.baseline, what="--baseline"),
        disparity_px=pixels(request.sigma_disparity, option="--sigma-disparity") or 0.08,
        pixels_per_sample=12.0,
        scale_sigma=request.sigma_scale / 100,
    )
